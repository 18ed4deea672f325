// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <vector>

#include "plumbline/rig/motion.hpp"
#include "refine/reprojection_cost.hpp"

namespace plumbline::detail {

/// What a view of a moving board is made of.
struct MovingView {
  Lens lens;  ///< its kind; the parameters come from the block
  std::vector<Observation> observations;
  MotionStencil stencil;
  double start_s = 0;     ///< from the frame's time, by the camera's own clock
  double middle_row = 0;  ///< [px]
  Loss loss = Loss::kSquared;
  double loss_scale = 1;
  bool further_board = false, bowed = false;
};

/// The cost of one view whose rows or clock are not at the frame's time: as make_view_cost(), over the blocks
/// [lens parameters | T_cam_rig (7) | five T_rig_board (7 each) | line delay (1) | time offset (1)], and
/// where they are there [... | T_board0_board (7)] and [... | bow (2)]. Each point is where project_moving()
/// sees it, so that the derivatives are those of the row too: with a = d(px)/d(row of exposure), d(px) = (I +
/// a e_y' / (1 - a_y)) times the derivative in a fixed row.
std::unique_ptr<ceres::CostFunction> make_moving_cost(MovingView view);

}  // namespace plumbline::detail
