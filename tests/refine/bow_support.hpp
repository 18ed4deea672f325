// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "refine_support.hpp"

namespace plumbline::test {

/// Bends the boards of a simulation: pixels anew by OpenCV's projection of z += b_x 4 u (1 - u) + b_y 4 v (1
/// - v), where u and v run from 0 to 1 over the board. That is mrcal's way of writing it.
inline void bend(Simulation& sim, const Vec2& bow_m) {
  Calibration& truth = sim.truth;
  for (View& view : truth.data.views) {
    const auto& points = truth.data.targets[view.target].points;
    const Vec3 far = points.back();
    for (Corner& c : view.corners) {
      Vec3 p = points[c.point];
      const double u = p.x() / far.x(), v = p.y() / far.y();
      p.z() = 4 * (bow_m.x() * u * (1 - u) + bow_m.y() * v * (1 - v));
      const SE3 T = truth.rig.T_cam_rig[view.cam] * *board_pose(truth, view);
      c.px = *project_by_opencv(truth.rig.cameras[view.cam].lens, T * p);
    }
  }
}

/// Two boards that stand still to one another, in turn in the frames of a scene of one board.
inline Simulation with_second_board(Simulation sim) {
  Calibration& truth = sim.truth;
  truth.data.targets.push_back(truth.data.targets[0]);
  truth.data.targets[0].name = "first";
  truth.data.targets[1].name = "second";
  truth.T_board0_board.push_back(SE3(so3_exp(Vec3(0.1, 0.2, -0.05)), Vec3(0.02, -0.03, 0.05)));
  const std::size_t n = truth.data.views.size();
  for (std::size_t v = 0; v < n; ++v) {
    View view = truth.data.views[v];
    view.target = 1;
    view.image += "b";
    truth.data.views.push_back(view);
  }
  std::stable_sort(truth.data.views.begin(), truth.data.views.end(), [](const View& a, const View& b) {
    return std::tuple(a.cam, a.frame, a.target) < std::tuple(b.cam, b.frame, b.target);
  });
  return sim;
}

}  // namespace plumbline::test
