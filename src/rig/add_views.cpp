// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rig/add_views.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "plumbline/core/text.hpp"

namespace plumbline {
namespace {

Error bad(std::string message, std::string where) {
  return {ErrorCode::kInvalidData, std::move(message), std::move(where)};
}

// The old index of each camera.
Result<std::vector<int>> match_cameras(const Dataset& old, const Dataset& more) {
  std::vector<int> matches;
  for (const CameraInfo& info : more.cameras) {
    const auto at = std::find_if(old.cameras.begin(), old.cameras.end(),
                                 [&](const CameraInfo& other) { return other.name == info.name; });
    if (at == old.cameras.end()) {
      std::vector<std::string> names;
      for (const CameraInfo& other : old.cameras) names.push_back(other.name);
      return bad("the earlier calibration has no camera of this name; it has: " + join(names, ", ") +
                     "; give the new images one of these names",
                 "camera " + info.name);
    }
    if (!(at->size == info.size))
      return bad(fmt::format("its images are {}x{}, the earlier ones {}x{}", info.size.width,
                             info.size.height, at->size.width, at->size.height),
                 "camera " + info.name);
    matches.push_back(static_cast<int>(at - old.cameras.begin()));
  }
  return matches;
}

// The old index of each board.
Result<std::vector<int>> match_targets(const Dataset& old, const Dataset& more) {
  std::vector<int> matches;
  for (const Target& target : more.targets) {
    const auto at = std::find_if(old.targets.begin(), old.targets.end(),
                                 [&](const Target& other) { return other.spec == target.spec; });
    if (at == old.targets.end()) {
      std::vector<std::string> names;
      for (const Target& other : old.targets) names.push_back(other.name);
      return bad(fmt::format("the earlier views show {}, the new ones {}; the board must be the same, to its "
                             "measures",
                             join(names, ", "), target.name),
                 "target");
    }
    matches.push_back(static_cast<int>(at - old.targets.begin()));
  }
  return matches;
}

// A name for a new frame that no other has: "01", "01 (2)", ...
std::string free_name(const std::vector<std::string>& taken, const std::string& wanted) {
  std::string name = wanted;
  for (int n = 2; std::find(taken.begin(), taken.end(), name) != taken.end(); ++n)
    name = fmt::format("{} ({})", wanted, n);
  return name;
}

std::string seconds(double t) { return fmt::format("{:.6f} s", t); }

// What brings the times of the new views to the axis of the old ones. Each recording counts from a zero of
// its own: where images take the place of old ones, both are of one recording and those say how the zeros
// differ; otherwise the new ones begin so long after the old ones that no motion leads from these to those.
// Whole seconds, so that differences keep their digits. \param replaced  the old time and the new one of each
// image that takes the place of another
Result<double> time_shift_s(const Dataset& old, const Dataset& more,
                            const std::vector<std::pair<const View*, double>>& replaced) {
  constexpr double kPause_s = 10, kSame_s = 1e-6;
  if (!replaced.empty()) {
    const auto& [first, first_old_s] = replaced.front();
    const double shift_s = first_old_s - *first->time_s;
    for (const auto& [view, old_s] : replaced) {
      if (std::abs(old_s - *view->time_s - shift_s) <= kSame_s) continue;
      return bad(
          fmt::format("it was taken {} after {} by the earlier times and {} by the new ones; give the "
                      "times of the same recording",
                      seconds(old_s - first_old_s), first->image, seconds(*view->time_s - *first->time_s)),
          "image " + view->image);
    }
    return shift_s;
  }
  std::optional<double> end_s, start_s;
  for (const View& view : old.views) {
    if (view.time_s) end_s = std::max(end_s.value_or(*view.time_s), *view.time_s);
  }
  for (const View& view : more.views) {
    if (view.time_s) start_s = std::min(start_s.value_or(*view.time_s), *view.time_s);
  }
  return end_s && start_s ? std::ceil(*end_s) + kPause_s - std::floor(*start_s) : 0.0;
}

}  // namespace

Result<Calibration> add_views(const Calibration& old, const Dataset& more, bool replace) {
  const auto targets = match_targets(old.data, more);
  if (!targets) return targets.error();
  const auto cameras = match_cameras(old.data, more);
  if (!cameras) return cameras.error();
  Calibration cal;
  cal.rig = old.rig;
  cal.data = old.data;
  cal.T_rig_board = old.T_rig_board;
  cal.T_board0_board = old.T_board0_board;
  cal.bow_m = old.bow_m;
  cal.clocks = old.clocks;
  cal.provenance = old.provenance;

  std::vector<int> frame_of(more.frames.size(), -1);
  std::set<std::string> there;
  std::vector<std::pair<const View*, double>> replaced;
  std::map<const View*, double> kept_s;  // of the image that a view without a time takes the place of
  for (const View& view : more.views) {
    const int cam = (*cameras)[view.cam];
    std::erase_if(cal.data.views, [&](const View& other) {
      if (other.cam != cam || other.image != view.image) return false;
      there.insert(view.image);
      if (view.time_s && other.time_s) replaced.emplace_back(&view, *other.time_s);
      if (!view.time_s && other.time_s) kept_s[&view] = *other.time_s;
      frame_of[view.frame] = other.frame;
      cal.T_rig_board[other.frame].reset();
      return true;
    });
  }
  if (!there.empty() && !replace) {
    std::vector<std::string> named(there.begin(), there.end());
    if (named.size() > 5) named.resize(5);
    return bad(
        fmt::format(
            "{} of the new images are there already ({}{}); leave them away, or have them take the place of "
            "the old ones (--replace)",
            there.size(), join(named, ", "), there.size() > named.size() ? ", ..." : ""),
        "views");
  }
  const auto shift_s = time_shift_s(old.data, more, replaced);
  if (!shift_s) return shift_s.error();
  for (const View& added : more.views) {
    View view = added;
    int& frame = frame_of[view.frame];
    if (frame < 0) {
      frame = static_cast<int>(cal.data.frames.size());
      cal.data.frames.push_back(free_name(cal.data.frames, more.frames[view.frame]));
      cal.T_rig_board.emplace_back();
    }
    if (view.time_s) *view.time_s += *shift_s;
    if (const auto kept = kept_s.find(&added); kept != kept_s.end()) view.time_s = kept->second;
    view.cam = (*cameras)[view.cam];
    view.frame = frame;
    view.target = (*targets)[view.target];
    cal.data.views.push_back(std::move(view));
  }
  std::stable_sort(cal.data.views.begin(), cal.data.views.end(), [](const View& a, const View& b) {
    if (a.cam != b.cam) return a.cam < b.cam;
    return a.image != b.image ? natural_less(a.image, b.image) : a.target < b.target;
  });
  if (!more.detector.empty() && more.detector != cal.data.detector)
    cal.data.detector += (cal.data.detector.empty() ? "" : "; added: ") + more.detector;
  if (auto status = validate(cal.data); !status) return status.error();
  cal.fits.resize(cal.data.views.size());
  cal.view_reason.resize(cal.data.views.size());
  return cal;
}

}  // namespace plumbline
