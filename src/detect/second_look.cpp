// SPDX-License-Identifier: Apache-2.0
#include "plumbline/detect/second_look.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>

#include "detect/charuco.hpp"
#include "detect/look_view.hpp"
#include "detect/single_threaded.hpp"
#include "detect/tangent_view.hpp"
#include "plumbline/core/parallel.hpp"
#include "plumbline/detect/circle_bias.hpp"
#include "plumbline/image/image.hpp"
#include "plumbline/linear/pose.hpp"
#include "plumbline/linear/ransac.hpp"
#include "plumbline/rig/validity.hpp"

namespace plumbline {
namespace {

using namespace detail;

constexpr double kMinDetected = 6;  ///< corners in a tangent view that give a pose

/// A target's points and print, for one diameter of its discs.
struct Board {
  std::vector<Vec3> p_target;
  std::vector<PointFeature> features;
  bool has_discs = false;
};

Board board_of(const Calibration& cal, int target, double diameter_m) {
  Board out;
  out.features = point_features(cal.data.targets[target], diameter_m);
  for (std::size_t i = 0; i < cal.data.targets[target].points.size(); ++i)
    out.p_target.push_back(board_point(cal, target, static_cast<int>(i)));
  out.has_discs = !out.features.empty() && out.features[0].radius > 0;
  return out;
}

/// What one view gave.
struct Looked {
  bool is_read = false;
  std::optional<Error> error;
  std::optional<ViewAfter> saddles;
  std::vector<MeasuredDisc> discs;
  SE3 T_cam_target;
};

class Looker {
 public:
  Looker(const std::vector<CameraImages>& cameras, const Calibration& cal, const SecondLookOptions& options)
      : cameras_(cameras), options_(options), cal_(cal) {}

  Result<SecondLook> run();

 private:
  Status find_files();
  void find_tangent_views(const std::vector<int>& views);
  void look_at(const std::vector<int>& views);
  Looked look(int v, const Result<Photograph>& photograph) const;
  std::optional<SE3> known_pose(int v) const;
  std::optional<SE3> searched_pose(int v, const cv::Mat& grey) const;
  std::vector<int> views_without_pose() const;
  bool is_worth_reading(int v) const;
  Status take(const std::vector<int>& views);
  void take_discs(int v);
  void measure_diameters();
  ViewBefore before(int v, const SE3& T_cam_target) const;
  bool has_discs(int v) const { return boards_[cal_.data.views[v].target].has_discs; }

  const std::vector<CameraImages>& cameras_;
  const SecondLookOptions& options_;
  Calibration cal_;
  std::vector<std::filesystem::path> files_;             ///< per view
  std::vector<Board> boards_;                            ///< per target
  std::vector<std::vector<TangentView>> tangent_views_;  ///< per camera
  std::vector<std::optional<SE3>> T_looked_;             ///< per view: pose in the camera, where it was found
  std::vector<Looked> looked_;
  SecondLook out_;
};

Status Looker::find_files() {
  std::map<std::pair<std::string, std::string>, const std::filesystem::path*> by_name;
  for (const CameraImages& camera : cameras_) {
    for (std::size_t i = 0; i < camera.files.size(); ++i)
      by_name[{camera.camera, camera.names[i]}] = &camera.files[i];
  }
  for (const View& view : cal_.data.views) {
    const auto found = by_name.find({cal_.data.cameras[view.cam].name, view.image});
    if (found == by_name.end()) {
      return Error{ErrorCode::kInvalidData,
                   "it is in the data set, but not among the images to look at again",
                   cal_.data.cameras[view.cam].name + ": " + view.image};
    }
    files_.push_back(*found->second);
  }
  return {};
}

std::optional<SE3> Looker::known_pose(int v) const {
  const View& view = cal_.data.views[v];
  if (T_looked_[v]) return T_looked_[v];
  const auto T_rig_board = board_pose(cal_, view);
  if (T_rig_board) return cal_.rig.T_cam_rig[view.cam] * *T_rig_board;
  if (static_cast<int>(view.corners.size()) < 4) return std::nullopt;
  // A frame that the calibration did not use; its own corners say where the board was.
  std::vector<Vec3> p;
  std::vector<Vec2> px;
  for (const Corner& c : view.corners)
    p.push_back(boards_[view.target].p_target[c.point]), px.push_back(c.px);
  RansacOptions ransac;
  ransac.inlier_px = 2;
  const auto pose = pose_ransac(cal_.rig.cameras[view.cam].lens, p, px, ransac);
  return pose ? std::optional(pose->model) : std::nullopt;
}

ViewBefore Looker::before(int v, const SE3& T_cam_target) const {
  const View& view = cal_.data.views[v];
  const Board& board = boards_[view.target];
  return {&cal_.rig.cameras[view.cam],
          &board.p_target,
          &board.features,
          T_cam_target,
          view.corners,
          camera_rms_px(cal_, view.cam) / std::sqrt(2.0)};
}

bool Looker::is_worth_reading(int v) const {
  const View& view = cal_.data.views[v];
  const Board& board = boards_[view.target];
  if (board.features.empty() || is_near_duplicate(view)) return false;
  if (board.has_discs && !view.corners.empty()) return true;
  const auto T = known_pose(v);
  if (!T) return view.corners.empty();
  const Camera& camera = cal_.rig.cameras[view.cam];
  std::size_t n = 0;
  for (std::size_t i = 0; i < board.p_target.size(); ++i) {
    const auto px = project(camera, *T * board.p_target[i]);
    n += px && px->x() >= 2 && px->y() >= 2 && px->x() <= camera.size.width - 3 &&
         px->y() <= camera.size.height - 3;
  }
  return n > view.corners.size();
}

std::optional<SE3> Looker::searched_pose(int v, const cv::Mat& grey) const {
  const View& view = cal_.data.views[v];
  const Camera& camera = cal_.rig.cameras[view.cam];
  std::vector<Vec3> p;
  std::vector<Vec2> px;
  for (const TangentView& tangent : tangent_views_[view.cam]) {
    const auto found = detect_target(warp(grey, tangent), cal_.data.targets[view.target]);
    if (!found || found->corners.size() <= p.size()) continue;
    // A part of a board that fits both layouts says nothing of its ids.
    const auto* charuco = std::get_if<Charuco>(&cal_.data.targets[view.target].spec);
    if (charuco && has_open_layout(*charuco) && found->layout_vote == 0) continue;
    p.clear(), px.clear();
    for (const Corner& c : found->corners) {
      if (const auto at = camera_px(camera, tangent, c.px))
        p.push_back(boards_[view.target].p_target[c.point]), px.push_back(*at);
    }
    if (p.size() == boards_[view.target].p_target.size()) break;
  }
  if (static_cast<double>(p.size()) < kMinDetected) return std::nullopt;
  RansacOptions ransac;
  ransac.inlier_px = 3;
  const auto pose = pose_ransac(camera.lens, p, px, ransac);
  return pose ? std::optional(pose->model) : std::nullopt;
}

Looked Looker::look(int v, const Result<Photograph>& photograph) const {
  Looked out;
  const View& view = cal_.data.views[v];
  if (!photograph) {
    out.error = Error{photograph.error().code, photograph.error().message, view.image};
    return out;
  }
  const cv::Mat& grey = photograph->pixels;
  out.is_read = true;
  auto T = known_pose(v);
  if (!T) T = searched_pose(v, grey);
  if (!T) return out;
  out.T_cam_target = *T;
  if (!has_discs(v)) {
    out.saddles = look_for_saddles(grey, before(v, *T));
    return out;
  }
  ViewBefore b = before(v, *T);
  // How large the discs are is seen before they are measured.
  std::vector<PointFeature> own;
  if (const double seen = disc_diameter(grey, b); seen > 0) {
    own = point_features(cal_.data.targets[view.target], seen * b.features->front().u.norm());
    b.features = &own;
  }
  out.discs = look_for_discs(grey, b);
  return out;
}

void Looker::look_at(const std::vector<int>& views) {
  std::mutex lock;
  int done = 0;
  std::vector<std::filesystem::path> files;
  for (const int v : views) files.push_back(files_[v]);
  for_each_image(files, ReadAs::kGrey8, options_.n_threads, [&](int i, const Result<Photograph>& photograph) {
    looked_[views[i]] = look(views[i], photograph);
    const std::lock_guard hold(lock);
    ++done;
    if (options_.progress) options_.progress(done, static_cast<int>(views.size()));
  });
}

void Looker::find_tangent_views(const std::vector<int>& views) {
  std::vector<char> is_wanted(cal_.rig.cameras.size(), 0);
  for (const int v : views) {
    const View& view = cal_.data.views[v];
    if (view.corners.empty() && !known_pose(v) && tangent_views_[view.cam].empty()) is_wanted[view.cam] = 1;
  }
  parallel_for(static_cast<int>(is_wanted.size()), options_.n_threads, [&](int cam) {
    if (is_wanted[cam] != 0) tangent_views_[cam] = tangent_views(cal_.rig.cameras[cam]);
  });
}

/// Discs keep their centroids as corners until the diameter is known. What was no clear disc goes.
void Looker::take_discs(int v) {
  View& view = cal_.data.views[v];
  view.corners.clear();
  for (const MeasuredDisc& d : looked_[v].discs) view.corners.push_back({d.point, d.centroid_px, d.sigma_px});
}

Status Looker::take(const std::vector<int>& views) {
  for (const int v : views) {
    const Looked& looked = looked_[v];
    if (looked.error) return *looked.error;
    out_.n_images += looked.is_read ? 1 : 0;
    View& view = cal_.data.views[v];
    const std::vector<Corner> before = view.corners;
    SE3 T = looked.T_cam_target;
    if (looked.saddles)
      view.corners = looked.saddles->corners, T = looked.saddles->T_cam_target;
    else if (2 * looked.discs.size() > before.size())
      take_discs(v);
    else
      continue;
    LookCount& count = out_.by_camera[view.cam];
    for (const Corner& c : view.corners) {
      count.corners +=
          std::none_of(before.begin(), before.end(), [&](const Corner& old) { return old.point == c.point; });
    }
    count.views += before.empty() ? 1 : 0;
    view.reason.clear();
    T_looked_[v] = T;
    auto& T_rig_board = cal_.T_rig_board[view.frame];
    if (!T_rig_board)
      T_rig_board = cal_.rig.T_cam_rig[view.cam].inverse() * T * cal_.T_board0_board[view.target].inverse();
  }
  return {};
}

void Looker::measure_diameters() {
  std::vector<std::vector<double>> seen(boards_.size());
  for (std::size_t v = 0; v < looked_.size(); ++v) {
    for (const MeasuredDisc& d : looked_[v].discs) {
      const int target = cal_.data.views[v].target;
      seen[target].push_back(d.diameter * boards_[target].features[d.point].u.norm());
    }
  }
  for (std::size_t t = 0; t < seen.size(); ++t) {
    if (seen[t].empty()) continue;
    std::nth_element(seen[t].begin(), seen[t].begin() + static_cast<long>(seen[t].size() / 2), seen[t].end());
    out_.diameter_m[t] = seen[t][seen[t].size() / 2];
    boards_[t] = board_of(cal_, static_cast<int>(t), out_.diameter_m[t]);
  }
}

std::vector<int> Looker::views_without_pose() const {
  std::vector<int> out;
  for (int v = 0; v < static_cast<int>(cal_.data.views.size()); ++v) {
    if (cal_.data.views[v].corners.empty() && !cal_.T_rig_board[cal_.data.views[v].frame]) out.push_back(v);
  }
  return out;
}

Result<SecondLook> Looker::run() {
  const int n_views = static_cast<int>(cal_.data.views.size());
  out_.by_camera.resize(cal_.data.cameras.size());
  out_.diameter_m.assign(cal_.data.targets.size(), 0);
  tangent_views_.resize(cal_.data.cameras.size());
  T_looked_.resize(cal_.data.views.size());
  looked_.resize(cal_.data.views.size());
  if (Status s = find_files(); !s) return s.error();
  for (int t = 0; t < static_cast<int>(cal_.data.targets.size()); ++t)
    boards_.push_back(board_of(cal_, t, 0));
  // First the views whose corners say what the print is like and where the boards stood, then the empty ones,
  // and of those that stay empty the ones whose frame has got a pose by then.
  std::vector<int> seen, empty;
  for (int v = 0; v < n_views; ++v) {
    if (is_worth_reading(v)) (cal_.data.views[v].corners.empty() ? empty : seen).push_back(v);
  }
  look_at(seen);
  if (Status s = take(seen); !s) return s.error();
  measure_diameters();
  const std::vector<int> lost = views_without_pose();
  find_tangent_views(empty);
  look_at(empty);
  if (Status s = take(empty); !s) return s.error();
  std::vector<int> again;
  for (const int v : lost) {
    if (cal_.data.views[v].corners.empty() && known_pose(v) && is_worth_reading(v)) again.push_back(v);
  }
  look_at(again);
  if (Status s = take(again); !s) return s.error();
  measure_diameters();
  for (int v = 0; v < n_views; ++v) {
    if (!T_looked_[v] || looked_[v].discs.empty()) continue;
    CircleCentroids c{v, {}};
    for (const Corner& corner : cal_.data.views[v].corners) c.px.push_back(corner.px);
    out_.circles.push_back(std::move(c));
  }
  for (std::size_t v = 0; v < cal_.fits.size(); ++v) cal_.fits[v].clear();
  cal_.stats = {};
  cal_.covariance.reset();
  out_.start = std::move(cal_);
  correct_circles(out_, out_.start);
  return std::move(out_);
}

}  // namespace

Result<SecondLook> look_again(const std::vector<CameraImages>& cameras, const Calibration& calibration,
                              const SecondLookOptions& options) {
  PLUMBLINE_CHECK(calibration.fits.size() == calibration.data.views.size() &&
                      calibration.T_rig_board.size() == calibration.data.frames.size(),
                  "fits and poses belong to the data");
  const OpenCvSingleThreaded guard;
  return Looker(cameras, calibration, options).run();
}

}  // namespace plumbline
