// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rig/add_views.hpp"

#include <fmt/format.h>

#include <algorithm>
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
      return bad("the earlier calibration has no camera of this name; it has: " + join(names, ", "),
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
      return bad(fmt::format("the earlier views show {}, the new ones {}", join(names, ", "), target.name),
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
  for (const View& view : more.views) {
    const int cam = (*cameras)[view.cam];
    std::erase_if(cal.data.views, [&](const View& other) {
      if (other.cam != cam || other.image != view.image) return false;
      there.insert(view.image);
      frame_of[view.frame] = other.frame;
      cal.T_rig_board[other.frame].reset();
      return true;
    });
  }
  if (!there.empty() && !replace) {
    std::vector<std::string> named(there.begin(), there.end());
    if (named.size() > 5) named.resize(5);
    return bad(
        fmt::format("{} of the new images are there already ({}{}); leave them away, or have them replaced",
                    there.size(), join(named, ", "), there.size() > named.size() ? ", ..." : ""),
        "views");
  }
  for (View view : more.views) {
    int& frame = frame_of[view.frame];
    if (frame < 0) {
      frame = static_cast<int>(cal.data.frames.size());
      cal.data.frames.push_back(free_name(cal.data.frames, more.frames[view.frame]));
      cal.T_rig_board.emplace_back();
    }
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
