// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <vector>

#include "plumbline/synth/board.hpp"

namespace plumbline::detail {

/// The four corners of a pixel on a board [m]: (-0.5, -0.5), (+0.5, -0.5), (+0.5, +0.5), (-0.5, +0.5) of its
/// centre.
using Quad = std::array<Vec2, 4>;

/// Finds the shapes near a place without looking at all of them: a uniform grid of cells over the drawing.
class ShapeIndex {
 public:
  explicit ShapeIndex(const BoardDrawing& drawing);
  /// Indices of the shapes whose cells touch the rectangle, each once, ascending: boxes first, then
  /// boxes.size() + i for disc i. `found` is cleared first.
  void find(const Vec2& low, const Vec2& high, std::vector<int>& found) const;
  /// Whether the point is black; agrees with is_black.
  bool is_black(const Vec2& p) const;

 private:
  int cell(double x, int axis) const;
  const BoardDrawing* drawing_;
  std::array<int, 2> n_cells_{1, 1};
  Vec2 low_, cell_size_;
  std::vector<std::vector<int>> cells_;
};

/// Share of the pixel's area, measured in the IMAGE, that lies in the box, resp. in the disc; in [0, 1].
/// \pre the quad is convex and in front of the camera
class PixelArea {
 public:
  explicit PixelArea(const Quad& quad);
  double in_box(const Box& box) const;
  double in_disc(const Disc& disc) const;
  const Vec2& low() const { return low_; }
  const Vec2& high() const { return high_; }

 private:
  Quad quad_;
  Vec2 low_, high_;  // bounding box of the quad
  Mat3 H_board_px_;  // unit square to board
  Mat3 H_px_board_;  // up to scale
};

}  // namespace plumbline::detail
