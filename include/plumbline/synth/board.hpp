// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/target/target.hpp"

namespace plumbline {

/// A black rectangle with sides along the board's axes, low < high in both coordinates [m].
struct Box {
  Vec2 low, high;
};

/// A black disc [m].
struct Disc {
  Vec2 centre;
  double radius = 0;
};

/// What is printed for one flat board: black shapes on white, in the board's own frame (the frame of
/// Target::points). Shapes do not overlap; boxes may share edges.
struct BoardDrawing {
  std::string name;  ///< of the board: "charuco_8x11_30mm_4X4_50"
  std::string note;  ///< the sizes to check on paper: "square 30 mm, marker 22 mm, ids 0..43"
  std::vector<Box> boxes;
  std::vector<Disc> discs;
  Vec2 low, high;  ///< corners of the smallest rectangle around all shapes [m]
  double margin_m =
      0;  ///< white that belongs to the board on each side; the sheet is the pattern and its margin
  bool y_up = false;   ///< AprilGrid: y up and z out of the board; all others: y down and z into the board
  SE3 T_target_board;  ///< where this board stands in its target; the identity unless the target is a rig

  Vec2 size() const { return high - low; }                             ///< of the pattern [m]
  Vec2 sheet_low() const { return low - Vec2::Constant(margin_m); }    ///< [m]
  Vec2 sheet_high() const { return high + Vec2::Constant(margin_m); }  ///< [m]
};

/// The drawings of a target: one, or one per part of a rig, in the order of its parts. Marker bits are those
/// of OpenCV's ArUco dictionaries; AprilGrid codes those of the apriltag library with a black border of
/// AprilGrid::border modules (Kalibr: TWO), and black squares of spacing * tag_m at the tags' corners, as
/// Kalibr prints them. kUnsupported for free points.
Result<std::vector<BoardDrawing>> draw_target(const Target& target);

/// Whether the point [m, board frame] is on a black shape: the definition that printing and rendering are
/// tested by.
bool is_black(const BoardDrawing& drawing, const Vec2& p_board);

}  // namespace plumbline
