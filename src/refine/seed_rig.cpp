// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <numeric>
#include <set>

#include "plumbline/core/text.hpp"
#include "refine/rig_graph.hpp"
#include "refine/seed.hpp"
#include "refine/seed_place.hpp"

namespace plumbline::detail {

namespace {

void renumber(View& view, const std::vector<int>& permutation) {
  for (Corner& c : view.corners) c.point = permutation[c.point];
  std::sort(view.corners.begin(), view.corners.end(),
            [](const Corner& a, const Corner& b) { return a.point < b.point; });
}

// Cameras whose poses to one another are known, or boards. The first member gives the frame of the group.
struct Group {
  std::vector<int> members;  // in the order in which they came
  bool has(int i) const { return std::find(members.begin(), members.end(), i) != members.end(); }
};

// What can be joined next: a group of cameras or of boards, moved into the frame of another.
struct Join {
  bool of_boards = false;
  std::size_t into = 0, from = 0;
  std::vector<Link> links;
  std::size_t n_frames = 0;
  bool at_home = false;  // it makes the group of camera 0 grow, or boards that it sees
};

// Two groups of cameras, each with its own group of boards.
struct MotionJoin {
  std::size_t cams1 = 0, boards1 = 0, cams2 = 0, boards2 = 0;
  std::vector<MotionFrame> frames;
};

using PoseKey = std::tuple<std::size_t, std::size_t, int>;  // group of cameras, group of boards, frame

// The rig under construction.
class Builder {
 public:
  Builder(const Dataset& data, const std::vector<MonoData>& parts, const std::vector<Calibration>& monos);
  Status join_all();
  Calibration finish();

 private:
  std::size_t group_of_cam(int cam) const { return index_of(cams_, cam); }
  std::size_t group_of_board(int board) const { return index_of(boards_, board); }
  static std::size_t index_of(const std::vector<Group>& groups, int i) {
    return static_cast<std::size_t>(
        std::find_if(groups.begin(), groups.end(), [&](const Group& g) { return g.has(i); }) -
        groups.begin());
  }
  std::vector<Sight> sights() const;
  void find_poses();
  Link link_to_cameras(int view, const SE3& T_group_boards) const;
  Link link_to_boards(int view, const SE3& T_group_boards) const;
  std::vector<Join> joins() const;
  std::vector<MotionJoin> motion_joins() const;
  void apply(const Join& join);
  bool join_by_motion(std::string& refusal);
  void move_cameras(std::size_t into, std::size_t from, const SE3& T_from_into);
  void move_boards(std::size_t into, std::size_t from, const SE3& T_into_from);
  void choose_frame_poses();

  Calibration cal_;
  Symmetries symmetries_;
  std::vector<std::optional<SE3>> T_cam_board_;  // per view, from its camera alone
  std::vector<Group> cams_, boards_;
  std::vector<SE3> T_cam_group_, T_group_board_;  // the identity for the first of a group
  std::map<PoseKey, SE3> pose_;                   // of a group of boards before a group of cameras
  std::vector<std::string> renumbered_, by_motion_;
};

Builder::Builder(const Dataset& data, const std::vector<MonoData>& parts,
                 const std::vector<Calibration>& monos) {
  std::vector<Lens> lenses;
  for (const Calibration& mono : monos) lenses.push_back(mono.rig.cameras[0].lens);
  cal_ = empty_calibration(data, lenses);
  T_cam_board_.resize(data.views.size());
  for (std::size_t cam = 0; cam < monos.size(); ++cam) {
    for (std::size_t i = 0; i < parts[cam].view_index.size(); ++i) {
      const int v = parts[cam].view_index[i];
      cal_.view_reason[v] = monos[cam].view_reason[i];
      if (takes_part(monos[cam], i)) T_cam_board_[v] = monos[cam].T_rig_board[parts[cam].data.views[i].frame];
    }
    cams_.push_back({{static_cast<int>(cam)}});
  }
  for (const Target& target : data.targets) {
    boards_.push_back({{static_cast<int>(symmetries_.size())}});
    symmetries_.push_back(symmetries(target));
  }
  T_cam_group_.resize(cams_.size());
  T_group_board_.resize(boards_.size());
  find_poses();
}

std::vector<Sight> Builder::sights() const {
  std::vector<Sight> list;
  for (std::size_t v = 0; v < T_cam_board_.size(); ++v) {
    const View& view = cal_.data.views[v];
    if (T_cam_board_[v]) list.push_back({view.cam, view.frame, view.target});
  }
  return list;
}

// The camera that came first into its group gives a frame's pose.
void Builder::find_poses() {
  pose_.clear();
  for (std::size_t group = 0; group < cams_.size(); ++group) {
    for (int cam : cams_[group].members) {
      const SE3 T_group_cam = T_cam_group_[cam].inverse();
      for (std::size_t v = 0; v < T_cam_board_.size(); ++v) {
        const View& view = cal_.data.views[v];
        if (view.cam != cam || !T_cam_board_[v]) continue;
        const std::size_t boards = group_of_board(view.target);
        SE3 T = T_group_cam * *T_cam_board_[v];
        if (boards_[boards].members[0] != view.target) T = T * T_group_board_[view.target].inverse();
        pose_.try_emplace({group, boards, view.frame}, T);
      }
    }
  }
}

// X = T_from_into of the cameras that are to be moved.
Link Builder::link_to_cameras(int v, const SE3& T_group_boards) const {
  const View& view = cal_.data.views[v];
  Link link{v, std::nullopt, T_group_boards, *T_cam_board_[v]};
  if (cams_[group_of_cam(view.cam)].members[0] != view.cam) link.left = T_cam_group_[view.cam];
  if (boards_[group_of_board(view.target)].members[0] != view.target)
    link.right = link.right * T_group_board_[view.target];
  return link;
}

// X = T_into_from of the boards that are to be moved, seen from `T_group_boards` of the others.
Link Builder::link_to_boards(int v, const SE3& T_group_boards) const {
  const View& view = cal_.data.views[v];
  return {v, T_cam_group_[view.cam] * T_group_boards, T_group_board_[view.target], *T_cam_board_[v]};
}

std::vector<Join> Builder::joins() const {
  std::map<std::tuple<bool, std::size_t, std::size_t>, Join> found;
  std::map<std::tuple<bool, std::size_t, std::size_t>, std::set<int>> frames;
  const std::size_t home = group_of_cam(0);
  const auto add = [&](bool of_boards, std::size_t into, std::size_t from, int frame, bool at_home,
                       Link link) {
    Join& join = found[{of_boards, into, from}];
    join.of_boards = of_boards;
    join.into = into;
    join.from = from;
    join.at_home = join.at_home || at_home;
    join.links.push_back(std::move(link));
    frames[{of_boards, into, from}].insert(frame);
  };
  for (std::size_t v = 0; v < T_cam_board_.size(); ++v) {
    if (!T_cam_board_[v]) continue;
    const View& view = cal_.data.views[v];
    const std::size_t cams = group_of_cam(view.cam), boards = group_of_board(view.target);
    const int index = static_cast<int>(v);
    for (std::size_t other = 0; other < cams_.size(); ++other) {
      // Into the group with the lower first camera, so that camera 0 stays where it is.
      if (cams_[other].members[0] >= cams_[cams].members[0]) continue;
      const auto known = pose_.find({other, boards, view.frame});
      if (known != pose_.end())
        add(false, other, cams, view.frame, other == home, link_to_cameras(index, known->second));
    }
    for (std::size_t other = 0; other < boards_.size(); ++other) {
      if (boards_[other].members[0] >= boards_[boards].members[0]) continue;
      const auto known = pose_.find({cams, other, view.frame});
      if (known != pose_.end())
        add(true, other, boards, view.frame, cams == home, link_to_boards(index, known->second));
    }
  }
  std::vector<Join> list;
  for (auto& [key, join] : found) {
    join.n_frames = frames[key].size();
    list.push_back(std::move(join));
  }
  return list;
}

void Builder::move_cameras(std::size_t into, std::size_t from, const SE3& T_from_into) {
  for (int cam : cams_[from].members) {
    T_cam_group_[cam] = cams_[from].members[0] == cam ? T_from_into : T_cam_group_[cam] * T_from_into;
    cams_[into].members.push_back(cam);
  }
  cams_.erase(cams_.begin() + static_cast<std::ptrdiff_t>(from));
}

void Builder::move_boards(std::size_t into, std::size_t from, const SE3& T_into_from) {
  for (int board : boards_[from].members) {
    T_group_board_[board] =
        boards_[from].members[0] == board ? T_into_from : T_into_from * T_group_board_[board];
    boards_[into].members.push_back(board);
  }
  boards_.erase(boards_.begin() + static_cast<std::ptrdiff_t>(from));
}

void Builder::apply(const Join& join) {
  const Placement placement = place(cal_, join.links, symmetries_);
  for (std::size_t i = 0; i < join.links.size(); ++i) {
    if (placement.symmetry[i] == 0) continue;
    const Link& link = join.links[i];
    View& view = cal_.data.views[link.view];
    const Symmetry& symmetry = symmetries_[view.target][placement.symmetry[i]];
    renumber(view, symmetry.permutation);
    T_cam_board_[link.view] = link.T_cam_board * symmetry.T_board_board.inverse();
    renumbered_.push_back(view.image.empty()
                              ? cal_.rig.cameras[view.cam].name + " " + cal_.data.frames[view.frame]
                              : view.image);
  }
  if (join.of_boards)
    move_boards(join.into, join.from, placement.X);
  else
    move_cameras(join.into, join.from, placement.X);
  find_poses();
}

std::vector<MotionJoin> Builder::motion_joins() const {
  std::map<std::array<std::size_t, 4>, std::map<int, MotionFrame>> found;
  for (const auto& [key1, T_1] : pose_) {
    const auto& [cams1, boards1, frame] = key1;
    for (std::size_t cams2 = 0; cams2 < cams_.size(); ++cams2) {
      if (cams_[cams2].members[0] <= cams_[cams1].members[0]) continue;
      for (std::size_t boards2 = 0; boards2 < boards_.size(); ++boards2) {
        const auto other = pose_.find({cams2, boards2, frame});
        if (boards2 == boards1 || other == pose_.end()) continue;
        found[{cams1, boards1, cams2, boards2}][frame] = {T_1, other->second, {}};
      }
    }
  }
  std::vector<MotionJoin> list;
  for (auto& [key, frames] : found) {
    MotionJoin join{key[0], key[1], key[2], key[3], {}};
    for (std::size_t v = 0; v < T_cam_board_.size(); ++v) {
      const View& view = cal_.data.views[v];
      const auto at = frames.find(view.frame);
      if (!T_cam_board_[v] || at == frames.end()) continue;
      if (group_of_cam(view.cam) != join.cams2 || group_of_board(view.target) != join.boards2) continue;
      at->second.links.push_back(
          {static_cast<int>(v), T_cam_group_[view.cam], T_group_board_[view.target], *T_cam_board_[v]});
    }
    for (auto& [frame, motion] : frames) join.frames.push_back(std::move(motion));
    list.push_back(std::move(join));
  }
  std::stable_sort(list.begin(), list.end(), [](const MotionJoin& a, const MotionJoin& b) {
    return a.frames.size() > b.frames.size();
  });
  return list;
}

bool Builder::join_by_motion(std::string& refusal) {
  for (const MotionJoin& join : motion_joins()) {
    const auto name = [&](std::size_t cams) { return cal_.rig.cameras[cams_[cams].members[0]].name; };
    const auto found = place_by_motion(cal_, join.frames, symmetries_);
    if (!found) {
      if (refusal.empty())
        refusal = fmt::format("{} and {}: {}", name(join.cams1), name(join.cams2), found.error().message);
      continue;
    }
    by_motion_.push_back(fmt::format(
        "{} to {}: {} frames, turns up to {:.0f} degrees about axes {:.0f} degrees apart", name(join.cams2),
        name(join.cams1), found->turns.n_frames, found->turns.largest_turn_deg, found->turns.axes_deg));
    const bool keep = boards_[join.boards1].members[0] < boards_[join.boards2].members[0];
    if (keep)
      move_boards(join.boards1, join.boards2, found->T_board1_board2);
    else
      move_boards(join.boards2, join.boards1, found->T_board1_board2.inverse());
    move_cameras(join.cams1, join.cams2, found->T_cam1_cam2.inverse());
    find_poses();
    return true;
  }
  return false;
}

// By the frames that most views share, camera 0's group first: a spanning tree of the best-determined edges.
Status Builder::join_all() {
  std::string refusal;
  for (;;) {
    const std::vector<Join> list = joins();
    const Join* best = nullptr;
    for (const Join& join : list) {
      if (!best || std::pair(join.at_home, join.n_frames) > std::pair(best->at_home, best->n_frames))
        best = &join;
    }
    if (best) {
      apply(*best);
      continue;
    }
    refusal.clear();
    if (cams_.size() == 1 || !join_by_motion(refusal)) break;
  }
  if (cams_.size() == 1) return {};
  RigGroups groups{std::vector<int>(cal_.rig.cameras.size()), std::vector<int>(cal_.data.targets.size())};
  for (const Group& group : cams_) {
    const int root = *std::min_element(group.members.begin(), group.members.end());
    for (int cam : group.members) groups.of_cam[cam] = root;
  }
  return gap_error(cal_.data, sights(), groups, refusal);
}

// Among the views of a frame, the one whose pose suits all of them best.
void Builder::choose_frame_poses() {
  std::vector<std::vector<int>> views_of(cal_.T_rig_board.size());
  for (std::size_t v = 0; v < cal_.data.views.size(); ++v) {
    if (T_cam_board_[v]) views_of[cal_.data.views[v].frame].push_back(static_cast<int>(v));
  }
  for (std::size_t f = 0; f < views_of.size(); ++f) {
    double best = -1;
    for (int source : views_of[f]) {
      const View& from = cal_.data.views[source];
      SE3 T_rig_board = cal_.rig.T_cam_rig[from.cam].inverse() * *T_cam_board_[source];
      if (from.target > 0) T_rig_board = T_rig_board * cal_.T_board0_board[from.target].inverse();
      double sum = 0;
      for (int v : views_of[f]) {
        const View& view = cal_.data.views[v];
        Link link{v, std::nullopt, T_rig_board, {}};
        if (view.target > 0) link.right = T_rig_board * cal_.T_board0_board[view.target];
        sum += error_px(cal_, link, cal_.rig.T_cam_rig[view.cam], symmetries_[view.target][0]);
      }
      if (best >= 0 && !(sum < best)) continue;
      best = sum;
      cal_.T_rig_board[f] = T_rig_board;
    }
  }
}

Calibration Builder::finish() {
  cal_.rig.T_cam_rig = T_cam_group_;
  cal_.T_board0_board = T_group_board_;
  choose_frame_poses();
  for (std::size_t v = 0; v < cal_.data.views.size(); ++v) {
    if (T_cam_board_[v]) cal_.fits[v].resize(cal_.data.views[v].corners.size());
  }
  if (!renumbered_.empty()) {
    std::string& remark = cal_.data.detector;
    remark += fmt::format("{}{} views renumbered, because the board looks the same turned around: {}",
                          remark.empty() ? "" : "; ", renumbered_.size(), join(renumbered_, ", "));
  }
  evaluate(cal_);
  if (!by_motion_.empty()) cal_.provenance.options["joined by motion"] = join(by_motion_, "; ");
  return std::move(cal_);
}

}  // namespace

Result<Calibration> seed_rig(const Dataset& data, const std::vector<MonoData>& parts,
                             std::vector<Calibration> monos) {
  Builder builder(data, parts, monos);
  if (Status joined = builder.join_all(); !joined) return joined.error();
  return builder.finish();
}

}  // namespace plumbline::detail
