// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/start.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "plumbline/core/check.hpp"
#include "plumbline/core/text.hpp"
#include "refine/seed.hpp"
#include "refine/suspects.hpp"

namespace plumbline {
namespace {

using namespace detail;

// The camera of the rig for each camera of the data.
Result<std::vector<int>> match(const Dataset& data, const Rig& rig) {
  std::vector<int> matches;
  for (const CameraInfo& info : data.cameras) {
    auto at = rig.find(info.name);
    if (!at && data.cameras.size() == 1 && rig.cameras.size() == 1) at = 0;
    if (!at) {
      std::vector<std::string> names;
      for (const Camera& camera : rig.cameras) names.push_back(camera.name);
      return Error{ErrorCode::kInvalidData,
                   "the start has no camera of this name; it has: " + join(names, ", ") +
                       "; name the cameras of the images like these",
                   "camera " + info.name};
    }
    const ImageSize size = rig.cameras[*at].size;
    if (size.width > 0 && !(size == info.size))
      return Error{ErrorCode::kInvalidData,
                   fmt::format("its images are {}x{}, the start is for {}x{}", info.size.width,
                               info.size.height, size.width, size.height),
                   "camera " + info.name};
    matches.push_back(*at);
  }
  return matches;
}

Result<std::vector<Lens>> lenses_of(const Dataset& data, const Rig& rig, const std::vector<int>& matches,
                                    const std::vector<std::string>& names) {
  if (names.size() > 1 && names.size() != data.cameras.size())
    return Error{ErrorCode::kInvalidData,
                 fmt::format("{} lenses for {} cameras; give one for all, or one each", names.size(),
                             data.cameras.size()),
                 "options"};
  std::vector<Lens> lenses;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const Lens& lens = rig.cameras[matches[i]].lens;
    const std::string wanted = names.empty() ? "" : names[names.size() == 1 ? 0 : i];
    if (wanted.empty()) {
      lenses.push_back(lens);
      continue;
    }
    auto converted = convert_lens(lens, wanted, data.cameras[i].size);
    if (!converted) return converted.error();
    lenses.push_back(*converted);
  }
  return lenses;
}

// Squared distance of a view's corners from a board pose in the frame of the rig, each at most `cap`.
double misfit(const Calibration& cal, const View& view, const SE3& T_rig_board) {
  const Camera& camera = cal.rig.cameras[view.cam];
  const double cap = std::pow(0.05 * std::hypot(camera.size.width, camera.size.height), 2);
  const SE3 T_cam_board = cal.rig.T_cam_rig[view.cam] * T_rig_board * cal.T_board0_board[view.target];
  double sum = 0;
  for (const Corner& c : view.corners) {
    const auto px = project(camera.lens, T_cam_board * cal.data.targets[view.target].points[c.point]);
    sum += px ? std::min((*px - c.px).squaredNorm(), cap) : cap;
  }
  return sum;
}

// The pose of each frame that has none: of those that its views propose, the one that suits all of them best.
void pose_frames(Calibration& cal, const Dataset& sound) {
  for (std::size_t f = 0; f < cal.T_rig_board.size(); ++f) {
    if (cal.T_rig_board[f]) continue;
    double least = std::numeric_limits<double>::infinity();
    for (const View& source : sound.views) {
      if (source.frame != static_cast<int>(f) || source.corners.size() < 4) continue;
      const auto T_cam_board =
          find_pose(cal.rig.cameras[source.cam].lens, cal.data.targets[source.target], source);
      if (!T_cam_board) continue;
      const SE3 T_rig_board = cal.rig.T_cam_rig[source.cam].inverse() * *T_cam_board *
                              cal.T_board0_board[source.target].inverse();
      double sum = 0;
      for (const View& view : sound.views) {
        if (view.frame == static_cast<int>(f)) sum += misfit(cal, view, T_rig_board);
      }
      if (!(sum < least)) continue;
      least = sum;
      cal.T_rig_board[f] = T_rig_board;
    }
  }
}

Result<Calibration> place_cameras(const Dataset& data, const Dataset& sound,
                                  const std::vector<Lens>& lenses) {
  std::vector<MonoData> parts;
  std::vector<Calibration> monos;
  for (std::size_t cam = 0; cam < data.cameras.size(); ++cam) {
    parts.push_back(mono_data(sound, static_cast<int>(cam)));
    monos.push_back(empty_calibration(parts[cam].data, {lenses[cam]}));
    pose_views(monos[cam]);
  }
  return seed_rig(data, parts, std::move(monos));
}

}  // namespace

Result<Calibration> start_from(const Dataset& data, const Rig& rig, const StartFrom& options) {
  if (auto status = validate(data); !status) return status.error();
  PLUMBLINE_CHECK(options.T_rig_board.empty() || options.T_rig_board.size() == data.frames.size(),
                  "one known board pose or nullopt for each frame");
  PLUMBLINE_CHECK(options.T_board0_board.empty() || options.T_board0_board.size() == data.targets.size(),
                  "one place for each board, or none");
  const auto matches = match(data, rig);
  if (!matches) return matches.error();
  const auto lenses = lenses_of(data, rig, *matches, options.lenses);
  if (!lenses) return lenses.error();
  const Dataset sound = without_suspects(data, options.n_threads);
  Calibration cal = empty_calibration(data, *lenses);
  const bool places_known = options.places_known || data.cameras.size() == 1;
  const bool boards_known = data.targets.size() == 1 || !options.T_board0_board.empty();
  if (!places_known || !boards_known) {
    auto placed = place_cameras(data, sound, *lenses);
    if (!placed) return placed.error();
    cal = *std::move(placed);
  }
  if (places_known) {
    const SE3 T_rig_first = rig.T_cam_rig[matches->front()].inverse(), T_first_rig = T_rig_first.inverse();
    for (std::size_t i = 1; i < matches->size(); ++i)
      cal.rig.T_cam_rig[i] = rig.T_cam_rig[(*matches)[i]] * T_rig_first;
    if (!options.T_board0_board.empty()) cal.T_board0_board = options.T_board0_board;
    cal.T_rig_board.assign(data.frames.size(), std::nullopt);
    for (std::size_t f = 0; f < options.T_rig_board.size(); ++f) {
      if (options.T_rig_board[f]) cal.T_rig_board[f] = T_first_rig * *options.T_rig_board[f];
    }
    pose_frames(cal, sound);
  }
  bool any = false;
  for (std::size_t v = 0; v < data.views.size(); ++v) {
    const bool posed = cal.T_rig_board[data.views[v].frame].has_value();
    cal.fits[v].assign(posed ? data.views[v].corners.size() : 0, CornerFit{});
    any = any || posed;
  }
  if (!any)
    return Error{ErrorCode::kNotConverged,
                 "no view of the board fits the cameras of the start; do they belong to these images?", ""};
  evaluate(cal);
  return cal;
}

}  // namespace plumbline
