// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <optional>
#include <span>
#include <vector>

#include "plumbline/core/types.hpp"

/// Plane-to-image maps over a small part of a board. No lens is known yet, and over the whole board a wide
/// lens is no homography; over a few squares it is one to a fraction of a pixel.
namespace plumbline::detail {

/// The homography from board to image through n >= 4 pairs, scaled so that w > 0 at the first board point.
/// nullopt when the points do not determine it.
std::optional<Mat3> fit_plane(std::span<const Vec2> board, std::span<const Vec2> px);

/// The map of the unit square (0, 0), (1, 0), (1, 1), (0, 1) to four corners in that order (Heckbert 1989);
/// nullopt when they do not make a convex quadrangle.
std::optional<Mat3> square_to_quad(const std::array<Vec2, 4>& px);

/// H [p; 1] as a pixel; nullopt beyond the plane's horizon.
std::optional<Vec2> map_point(const Mat3& H, const Vec2& p);

/// d(map_point)/dp.
Mat2 map_jacobian(const Mat3& H, const Vec2& p);

/// The narrower height [px] of the parallelogram that a unit square is in the image. Not the shorter side:
/// seen along its diagonal a square has long sides that lie close together.
double narrow_height(const Mat2& J);

/// A marker in an image and the place that its id has on the board; both in the same order of corners.
struct PlacedQuad {
  int id = -1;
  std::array<Vec2, 4> board, px;
  Vec2 board_centre() const { return (board[0] + board[1] + board[2] + board[3]) / 4; }
};

/// The map from the board to the image by a square marker's own corners; nullopt when they make no convex
/// quadrangle.
std::optional<Mat3> plane_of(const PlacedQuad& quad);

/// Of markers that may be misread, misplaced or seen twice: the largest set in which each agrees with a
/// neighbour that the same board passes through both (each predicts the other's corners to a third of its
/// size). Indices ascending; one per id. A single marker agrees with itself.
struct ConsistentQuads {
  std::vector<int> index;
};
ConsistentQuads consistent_quads(std::span<const PlacedQuad> quads);

/// Perimeter over 4 [px].
double side_px(const std::array<Vec2, 4>& px);

}  // namespace plumbline::detail
