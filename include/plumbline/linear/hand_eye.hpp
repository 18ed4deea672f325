// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/geometry/se3.hpp"

namespace plumbline {

/// How much a set of motions turned: what a hand-eye problem can determine.
struct TurnSpread {
  double largest_turn_deg = 0;  ///< between any two frames
  /// How far the axes of the turns between all pairs of frames lie from one common axis: atan of the root
  /// mean square turn across it over that about it. 0: one axis; 45: turns about two axes alike.
  double axes_deg = 0;
  Vec3 axis_cam1 = Vec3::Zero();  ///< unit; that common axis, in the frame of camera 1
  int n_frames = 0;
};

/// Two cameras that are fixed to each other, each before a board of its own, and what only their common
/// motion tells.
struct HandEye {
  SE3 T_cam1_cam2;      ///< X
  SE3 T_board1_board2;  ///< Y
  TurnSpread turns;
  /// Root mean square over the frames of what is left between T_cam1_board1 Y and X T_cam2_board2.
  double rms_rad = 0, rms_m = 0;
};

/// X and Y with  T_cam1_board1[f] Y = X T_cam2_board2[f]  in every frame f: the hand-eye problem A X = X B
/// over the motions between any two frames, with the pose of the boards to each other. Closed form
/// (docs/linear.md): the sines of the turns along their axes fulfil a = R_X b (as the rotation vectors of
/// Park & Martin, "Robot sensor calibration: solving AX = XB on the Euclidean group", 1994, but smooth at
/// half turns), which the nearest rotation to the sum of a b' over all pairs of frames solves; R_Y is the
/// nearest to the sum of R_cam1_board1' R_X R_cam2_board2; and both translations follow from one linear
/// least-squares problem. Exact without noise, a start with it: refine the images jointly afterwards. Frames
/// that are wrong are not looked for. Unequal numbers throw std::invalid_argument. \returns kDegenerate names
/// what is missing: fewer than three frames; frames that hardly turn (the largest
///          turn); turns about one axis (that axis in camera 1, the angle between the axes, and that the
///          position of camera 2 along it is not determined); kInvalidData for NaN
Result<HandEye> hand_eye(std::span<const SE3> T_cam1_board1, std::span<const SE3> T_cam2_board2);

/// The turns of one camera's poses alone.
TurnSpread turn_spread(std::span<const SE3> T_cam1_board1);

}  // namespace plumbline
