// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "plumbline/geometry/so3.hpp"
#include "refine/block_normal.hpp"

/// One view in the block solver.
namespace plumbline::detail {

/// How steps of the three poses of a view's chain move its board in the camera's frame, as the kernel's
/// [dw | dt] sees it. p_cam = T_cam_rig T_rig_board T_board0_board p, each stepped by box_plus().
struct ViewChain {
  SE3 T_cam_board;
  Mat6 camera, frame, board;  ///< d[dw | dt] / d(step)
  bool one_pose;              ///< the first camera's view of the first board: `frame` is the identity

  ViewChain(const BlockState& state, const BlockView& view, std::size_t f) {
    const SE3 &T_cam_rig = state.T_cam_rig[view.cam], &T_rig_board = state.T_rig_board[f];
    one_pose = view.target == 0 && view.cam == 0 && T_cam_rig == SE3();
    if (one_pose) {
      T_cam_board = T_rig_board;
      return;
    }
    const SE3& T_board0_board = state.T_board0_board[view.target];
    const SE3 T_rig_this = T_rig_board * T_board0_board;
    T_cam_board = T_cam_rig * T_rig_this;
    const Mat3 R = T_cam_rig.R();
    camera = Mat6::Identity();  // also swings the board about the camera's centre
    camera.bottomLeftCorner<3, 3>() = -skew(R * T_rig_this.t());
    frame.setZero();
    frame.topLeftCorner<3, 3>() = frame.bottomRightCorner<3, 3>() = R;
    // Also swings this board about the first one's origin.
    frame.bottomLeftCorner<3, 3>() = -R * skew(T_rig_board.R() * T_board0_board.t());
    board.setZero();
    board.topLeftCorner<3, 3>() = board.bottomRightCorner<3, 3>() = R * T_rig_board.R();
  }
};

/// Adds one view: its frame's own blocks to `normal`, what is shared to `sums`. False when a corner lies
/// outside its lens' domain.
bool add_view(const BlockProblem& problem, const BlockState& state, std::size_t f, const BlockView& view,
              BlockNormal& normal, BlockSums& sums);

}  // namespace plumbline::detail
