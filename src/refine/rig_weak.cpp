// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "plumbline/core/linalg.hpp"
#include "plumbline/core/text.hpp"
#include "refine/rig_graph.hpp"
#include "refine/weak.hpp"

namespace plumbline::detail {
namespace {

constexpr double kWeakBaseline = 0.05, kWeakTurnDeg = 0.5;
constexpr double kDegPerRad = 180 / std::numbers::pi;

std::vector<Sight> sights_of(const Calibration& cal) {
  std::vector<Sight> list;
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    const View& view = cal.data.views[v];
    if (takes_part(cal, v)) list.push_back({view.cam, view.frame, view.target});
  }
  return list;
}

std::string direction_text(const VecX& d) {
  const double sign = d[2] < 0 || (d[2] == 0 && d[0] < 0) ? -1 : 1;
  return fmt::format("({:.2f}, {:.2f}, {:.2f})", sign * d[0], sign * d[1], sign * d[2]);
}

// One pose of `what` ("camera left"), its six numbers at `offset`, at `distance_m` from the first one.
void add_weak_pose(Calibration& cal, const MatX& covariance, const std::string& what, double distance_m,
                   int offset, const std::vector<std::string>& names, const char* next) {
  const double baseline_m = std::max(distance_m, 1e-12);
  const SymEigen turn = sym_eigen(covariance.block(offset, offset, 3, 3));
  const SymEigen shift = sym_eigen(covariance.block(offset + 3, offset + 3, 3, 3));
  const double turn_deg = kDegPerRad * std::sqrt(std::max(0.0, turn.values[2]));
  const double shift_m = std::sqrt(std::max(0.0, shift.values[2]));
  if (turn_deg > kWeakTurnDeg) {
    cal.stats.weak.push_back(
        {describe_direction(turn.vectors.col(2), names, offset).first, turn_deg / kDegPerRad,
         fmt::format("the rotation of {} is known to +-{:.2g} degrees only, about {}; {}", what, turn_deg,
                     direction_text(turn.vectors.col(2)), next)});
  }
  if (shift_m > kWeakBaseline * baseline_m) {
    cal.stats.weak.push_back(
        {describe_direction(shift.vectors.col(2), names, offset + 3).first, shift_m,
         fmt::format(
             "the position of {} is known to +-{:.2g} m only ({:.0f} % of the baseline), along {}; {}", what,
             shift_m, 100 * shift_m / baseline_m, direction_text(shift.vectors.col(2)), next)});
  }
}

double position_sigma_m(const MatX& covariance, int offset) {
  return std::sqrt(std::max(0.0, sym_eigen(covariance.block(offset + 3, offset + 3, 3, 3)).values[2]));
}

void add_bridges(Calibration& cal, const MatX& covariance, const Offsets& offsets,
                 const std::vector<Sight>& sights) {
  const int n_cams = static_cast<int>(cal.rig.cameras.size());
  for (const Bridge& bridge : bridges(n_cams, static_cast<int>(cal.data.targets.size()), sights)) {
    std::vector<std::string> cams, views;
    int first = -1;  // of those whose pose is not given
    for (int cam : bridge.cams) {
      if (covariance.diagonal().segment<6>(offsets.pose[cam]).isZero(0)) continue;
      if (first < 0) first = cam;
      cams.push_back(cal.rig.cameras[cam].name);
    }
    if (first < 0) continue;
    for (std::size_t v = 0; v < cal.fits.size(); ++v) {
      if (takes_part(cal, v) && cal.data.views[v].frame == bridge.frame)
        views.push_back(cal.rig.cameras[cal.data.views[v].cam].name);
    }
    cal.stats.weak.push_back(
        {cams[0] + " r_x, r_y, r_z, t_x, t_y, t_z", position_sigma_m(covariance, offsets.pose[first]),
         fmt::format("{} joined to camera {} by 1 frame: {} (seen by {}); an error in it goes into the rig "
                     "whole; add frames in which it sees the same board together with another camera",
                     cams.size() > 1 ? "cameras " + join(cams, ", ") + " are" : "camera " + cams[0] + " is",
                     cal.rig.cameras[0].name, cal.data.frames[bridge.frame], join(views, ", "))});
  }
}

}  // namespace

std::vector<bool> hold_loose_boards(const Calibration& cal, std::vector<bool> held) {
  const int n_boards = static_cast<int>(cal.data.targets.size());
  if (n_boards == 1) return held;
  // The cameras all hang together; so do boards that any of them saw in one frame.
  std::vector<Sight> sights = sights_of(cal);
  for (Sight& s : sights) s.cam = 0;
  const std::vector<int> groups = rig_groups(1, n_boards, sights, false).of_board;
  const Offsets offsets = offsets_of(cal);
  held.resize(offsets.total, false);
  for (int b = 1; b < n_boards; ++b) {
    if (groups[b] == b) std::fill_n(held.begin() + offsets.board[b], 6, true);
  }
  return held;
}

void add_weak_rig(Calibration& cal, const MatX& covariance, const std::vector<std::string>& names) {
  const Offsets offsets = offsets_of(cal);
  const std::vector<Sight> sights = sights_of(cal);
  for (std::size_t cam = 1; cam < cal.rig.cameras.size(); ++cam) {
    add_weak_pose(cal, covariance, "camera " + cal.rig.cameras[cam].name, cal.rig.T_cam_rig[cam].t().norm(),
                  offsets.pose[cam], names, "add frames in which both cameras see the board, near and far");
  }
  for (std::size_t b = 1; b < cal.data.targets.size(); ++b) {
    add_weak_pose(cal, covariance, "board " + cal.data.targets[b].name, cal.T_board0_board[b].t().norm(),
                  offsets.board[b], names, "add frames in which it is seen together with another board");
  }
  if (cal.rig.cameras.size() > 1) add_bridges(cal, covariance, offsets, sights);
  if (cal.data.targets.size() == 1) return;
  std::vector<Sight> as_one = sights;
  for (Sight& s : as_one) s.cam = 0;
  const std::vector<int> groups =
      rig_groups(1, static_cast<int>(cal.data.targets.size()), as_one, false).of_board;
  for (std::size_t b = 1; b < cal.data.targets.size(); ++b) {
    if (groups[b] != static_cast<int>(b)) continue;
    cal.stats.weak.push_back(
        {cal.data.targets[b].name + " r_x, r_y, r_z, t_x, t_y, t_z", 0,
         fmt::format(
             "no frame shows board {} together with one that hangs together with {}: its pose to that "
             "one is not determined and was held; nothing else depends on it",
             cal.data.targets[b].name, cal.data.targets[0].name)});
  }
}

}  // namespace plumbline::detail
