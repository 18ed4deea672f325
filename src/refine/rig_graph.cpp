// SPDX-License-Identifier: Apache-2.0
#include "refine/rig_graph.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <numeric>
#include <optional>
#include <set>

#include "plumbline/core/text.hpp"

namespace plumbline::detail {
namespace {

// Disjoint sets whose name is their lowest member.
class Sets {
 public:
  explicit Sets(int n) : parent_(static_cast<std::size_t>(n)) {
    std::iota(parent_.begin(), parent_.end(), 0);
  }
  int root(int i) const {
    while (parent_[i] != i) i = parent_[i];
    return i;
  }
  bool join(int a, int b) {
    a = root(a), b = root(b);
    if (a == b) return false;
    parent_[std::max(a, b)] = std::min(a, b);
    return true;
  }
  std::vector<int> roots() const {
    std::vector<int> all;
    for (std::size_t i = 0; i < parent_.size(); ++i) all.push_back(root(static_cast<int>(i)));
    return all;
  }

 private:
  std::vector<int> parent_;
};

// Joins by shared frames until nothing changes.
void join_by_sight(const std::vector<Sight>& sights, Sets& cams, Sets& boards) {
  for (bool changed = true; changed;) {
    changed = false;
    std::map<std::pair<int, int>, int> cam_at,
        board_at;  // (frame, group of boards) -> camera, and the reverse
    for (const Sight& s : sights) {
      const auto cam = cam_at.try_emplace({s.frame, boards.root(s.target)}, s.cam).first->second;
      const auto board = board_at.try_emplace({s.frame, cams.root(s.cam)}, s.target).first->second;
      if (cams.join(cam, s.cam)) changed = true;
      if (boards.join(board, s.target)) changed = true;
    }
  }
}

// One pair of groups on both sides that enough frames tie by motion; false when there is none.
bool join_by_motion(const std::vector<Sight>& sights, Sets& cams, Sets& boards) {
  using Pair = std::pair<int, int>;  // group of cameras, group of boards
  std::map<int, std::set<Pair>> in_frame;
  for (const Sight& s : sights) in_frame[s.frame].insert({cams.root(s.cam), boards.root(s.target)});
  std::map<std::pair<Pair, Pair>, int> count;
  for (const auto& [frame, pairs] : in_frame) {
    for (auto a = pairs.begin(); a != pairs.end(); ++a) {
      for (auto b = std::next(a); b != pairs.end(); ++b) ++count[{*a, *b}];
    }
  }
  for (const auto& [pairs, n] : count) {
    if (n < kLeastMotionFrames) continue;
    cams.join(pairs.first.first, pairs.second.first);
    boards.join(pairs.first.second, pairs.second.second);
    return true;
  }
  return false;
}

std::string names_of(const std::vector<std::string>& names) {
  return names.size() == 1 ? names[0] : "[" + join(names, ", ") + "]";
}

// "cam0", or "[cam0, cam2]"; with several boards what they saw.
std::string describe(const Dataset& data, const std::vector<Sight>& sights, const RigGroups& groups,
                     int group, bool with_boards) {
  std::vector<std::string> cams, boards;
  for (std::size_t cam = 0; cam < groups.of_cam.size(); ++cam) {
    if (groups.of_cam[cam] == group) cams.push_back(data.cameras[cam].name);
  }
  for (std::size_t b = 0; b < data.targets.size(); ++b) {
    std::set<int> frames;
    for (const Sight& s : sights) {
      if (s.target == static_cast<int>(b) && groups.of_cam[s.cam] == group) frames.insert(s.frame);
    }
    if (!frames.empty())
      boards.push_back(fmt::format("{} in {} frames", data.targets[b].name, frames.size()));
  }
  std::string text = names_of(cams);
  if (with_boards && !boards.empty()) text += " (sees " + join(boards, ", ") + ")";
  return text;
}

// "f5, f6, f7, ..."
std::string some(const Dataset& data, const std::vector<int>& frames) {
  constexpr std::size_t kMost = 3;
  std::vector<std::string> names;
  for (std::size_t i = 0; i < std::min(kMost, frames.size()); ++i) names.push_back(data.frames[frames[i]]);
  if (frames.size() > kMost) names.emplace_back("...");
  return join(names, ", ");
}

// For a pair of cameras of two groups, the frames of which both took an image and only one found a board: any
// of them would have joined the groups.
std::optional<std::string> near_misses(const Dataset& data, const std::set<std::array<int, 3>>& seen,
                                       const std::set<std::pair<int, int>>& taken, int a, int b) {
  std::array<std::set<int>, 2> only;
  for (const auto& [cam, frame, target] : seen) {
    if (cam != a && cam != b) continue;
    const int other = cam == a ? b : a;
    if (taken.contains({other, frame}) && !seen.contains({other, frame, target}))
      only[cam == a ? 0 : 1].insert(frame);
  }
  if (only[0].empty() && only[1].empty()) return std::nullopt;
  const std::string board = data.targets.size() > 1 ? "a board" : "the board";
  std::vector<std::string> texts;
  for (int side = 0; side < 2; ++side) {
    const std::vector<int> frames(only[side].begin(), only[side].end());
    if (frames.empty()) continue;
    texts.push_back(fmt::format(
        "{} show{} {} to {} only ({})",
        texts.empty() ? fmt::format("{} frame{}", frames.size(), frames.size() == 1 ? "" : "s")
                      : fmt::format("{}", frames.size()),
        frames.size() == 1 ? "s" : "", board, data.cameras[side == 0 ? a : b].name, some(data, frames)));
  }
  return fmt::format("{} and {} share none: {}", data.cameras[a].name, data.cameras[b].name,
                     join(texts, ", "));
}

// Pairs of cameras of different groups, those next to each other in the list first: people list cameras in
// the order in which they stand.
std::vector<std::string> all_near_misses(const Dataset& data, const std::vector<Sight>& sights,
                                         const RigGroups& groups) {
  constexpr std::size_t kMost = 4;
  std::set<std::array<int, 3>> seen;
  std::set<std::pair<int, int>> taken;
  for (const Sight& s : sights) seen.insert({s.cam, s.frame, s.target});
  for (const View& view : data.views) taken.insert({view.cam, view.frame});
  std::vector<std::string> texts;
  const int n_cams = static_cast<int>(data.cameras.size());
  for (int apart = 1; apart < n_cams; ++apart) {
    for (int a = 0; a + apart < n_cams && texts.size() < kMost; ++a) {
      if (groups.of_cam[a] == groups.of_cam[a + apart]) continue;
      if (auto text = near_misses(data, seen, taken, a, a + apart)) texts.push_back(*std::move(text));
    }
  }
  return texts;
}

// Whether images of two groups carry the same frame at all.
bool have_common_frames(const Dataset& data, const RigGroups& groups) {
  std::map<int, int> group_of_frame;
  for (const View& view : data.views) {
    const int group = groups.of_cam[view.cam];
    if (group_of_frame.try_emplace(view.frame, group).first->second != group) return true;
  }
  return false;
}

}  // namespace

RigGroups rig_groups(int n_cams, int n_boards, const std::vector<Sight>& sights, bool by_motion) {
  Sets cams(n_cams), boards(n_boards);
  do {
    join_by_sight(sights, cams, boards);
  } while (by_motion && join_by_motion(sights, cams, boards));
  return {cams.roots(), boards.roots()};
}

std::vector<Bridge> bridges(int n_cams, int n_boards, const std::vector<Sight>& sights) {
  std::set<int> frames;
  for (const Sight& s : sights) frames.insert(s.frame);
  std::vector<Bridge> list;
  // When nothing falls apart without several frames, it does not without one of them: halving finds the few
  // that matter.
  const auto search = [&](auto&& self, std::set<int> without) -> void {
    std::vector<Sight> others;
    std::copy_if(sights.begin(), sights.end(), std::back_inserter(others),
                 [&](const Sight& s) { return !without.contains(s.frame); });
    const RigGroups groups = rig_groups(n_cams, n_boards, others, true);
    Bridge bridge{*without.begin(), {}};
    for (int cam = 0; cam < n_cams; ++cam) {
      if (groups.of_cam[cam] != groups.of_cam[0]) bridge.cams.push_back(cam);
    }
    if (bridge.cams.empty()) return;
    if (without.size() == 1) return list.push_back(std::move(bridge));
    const auto middle = std::next(without.begin(), static_cast<std::ptrdiff_t>(without.size() / 2));
    self(self, {without.begin(), middle});
    self(self, {middle, without.end()});
  };
  const std::vector<int> all = rig_groups(n_cams, n_boards, sights, true).of_cam;
  const bool whole = std::all_of(all.begin(), all.end(), [](int group) { return group == 0; });
  if (n_cams > 1 && whole) search(search, frames);
  return list;
}

Error gap_error(const Dataset& data, const std::vector<Sight>& sights, const RigGroups& groups,
                const std::string& motion) {
  const std::set<int> roots(groups.of_cam.begin(), groups.of_cam.end());
  std::vector<std::string> parts, names;
  for (int root : roots) {
    parts.push_back(describe(data, sights, groups, root, true));
    names.push_back(describe(data, sights, groups, root, false));
  }
  std::string message = fmt::format(
      "cameras {} are not connected: no frame shows the same board to a camera of each group, nor does any "
      "chain "
      "of cameras and boards lead from one to the other; {}",
      join(names, " and "), join(parts, ", "));
  for (const std::string& near : all_near_misses(data, sights, groups)) message += "; " + near;
  if (!have_common_frames(data, groups))
    message += "; they have no frame in common at all: check that the --cam patterns pair the frames";
  message += "; take images in which a camera of each group sees the same board at once";
  if (!motion.empty())
    message += fmt::format(
        ", or turn the whole rig about two axes while each sees its own board; so far that does not do: {}",
        motion);
  return {ErrorCode::kDegenerate, std::move(message), "rig"};
}

}  // namespace plumbline::detail
