// SPDX-License-Identifier: Apache-2.0
// What every solver asks of a calibration.
#include "plumbline/rig/motion.hpp"
#include "refine/solve.hpp"

namespace plumbline::detail {

bool takes_part(const Calibration& cal, std::size_t v) {
  return !cal.fits[v].empty() && cal.T_rig_board[cal.data.views[v].frame].has_value();
}

std::vector<Observation> observations_of(const Calibration& cal, std::size_t v, bool use_sigma) {
  std::vector<Observation> list;
  if (!takes_part(cal, v)) return list;
  const View& view = cal.data.views[v];
  for (std::size_t i = 0; i < view.corners.size(); ++i) {
    if (cal.fits[v][i].outlier) continue;
    const Corner& c = view.corners[i];
    const Target& target = cal.data.targets[view.target];
    list.push_back({target.points[c.point], c.px, use_sigma ? 1.0 / c.sigma_px : 1.0});
    if (target.outline) list.back().bow_shape = bow_shape(*target.outline, target.points[c.point]);
  }
  return list;
}

Offsets offsets_of(const Rig& rig) {
  Offsets o;
  o.board.push_back(-1);
  for (const Camera& camera : rig.cameras) {
    o.lens.push_back(o.total);
    o.total += n_params(camera.lens);
  }
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    o.pose.push_back(i == 0 ? -1 : o.total);
    if (i > 0) o.total += 6;
  }
  return o;
}

Offsets offsets_of(const Calibration& cal) {
  Offsets o = offsets_of(cal.rig);
  for (std::size_t i = 1; i < cal.data.targets.size(); ++i, o.total += 6) o.board.push_back(o.total);
  for (std::size_t i = 0; i < cal.data.targets.size(); ++i) {
    const bool bowed = bow_of(cal, static_cast<int>(i)).has_value();
    o.bow.push_back(bowed ? o.total : -1);
    if (bowed) o.total += 2;
  }
  for (std::size_t i = 0; i < cal.rig.cameras.size(); ++i) {
    const CameraClock clock = i < cal.clocks.size() ? cal.clocks[i] : CameraClock{};
    o.line_delay.push_back(clock.line_delay_s ? o.total++ : -1);
    o.time_offset.push_back(clock.time_offset_s ? o.total++ : -1);
  }
  return o;
}

int evaluate(Calibration& cal) {
  int n_lost = 0;
  const auto trajectory = has_clocks(cal) ? std::optional(trajectory_of(cal)) : std::nullopt;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    if (!takes_part(cal, v)) continue;
    const View& view = cal.data.views[v];
    // predict() without a trajectory, with the view's motion put together once.
    const SE3 T_cam_board = cal.rig.T_cam_rig[view.cam] * *board_pose(cal, view);
    const Mat3 R = T_cam_board.R();
    const Vec3 t = T_cam_board.t();
    const Lens& lens = cal.rig.cameras[view.cam].lens;
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      CornerFit& fit = cal.fits[v][i];
      const int point = view.corners[i].point;
      const auto px = trajectory ? predict(cal, *trajectory, view, point)
                                 : project(lens, R * board_point(cal, view.target, point) + t);
      fit.residual_px = px ? Vec2(*px - view.corners[i].px) : Vec2::Zero();
      if (px) continue;
      fit.outlier = true;
      ++n_lost;
    }
  }
  return n_lost;
}

void hold_cores(const Rig& rig, std::vector<bool>& held) {
  const Offsets offsets = offsets_of(rig);
  for (std::size_t cam = 0; cam < rig.cameras.size(); ++cam) {
    if (holds_core(rig.cameras[cam].lens)) std::fill_n(held.begin() + offsets.lens[cam], 4, true);
  }
}

}  // namespace plumbline::detail
