// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "plumbline/core/types.hpp"

/// Points of an image where four fields of alternating brightness meet, and lattices of them.
namespace plumbline::detail {

/// No saddle of a lattice is looked for nearer to the image's border.
inline constexpr double kBorderPx = 9;

/// A saddle of the smoothed grey levels.
struct Saddle {
  Vec2 px;
  Vec2 edge[2];         ///< unit directions of the two edges; both signs mean the same
  Vec2 bright;          ///< unit direction into the brighter pair of fields
  double strength = 0;  ///< root of minus the determinant of the second differences [grey levels]
};

/// The saddles of an image, strongest first and at most `most` of them: extrema of the Hessian's determinant
/// (Beaudet 1978) above what the image's noise makes, around which the grey levels change sides four times.
std::vector<Saddle> find_saddles(const cv::Mat& grey, double noise, int most);

/// A node of a lattice: its place in whole steps from the seed, and its saddle.
struct LatticeNode {
  int i = 0, j = 0;
  int saddle = 0;
};

/// Calls is_last with each lattice until it says so. Lattices grow from cells of four saddles whose edges
/// point at one another and whose colours alternate, neighbour by neighbour, the strongest saddles first;
/// each place is foretold by those before it, so that no lens or plane is assumed. Their boxes have 3x3
/// places at least; the axes (i, j) are right-handed as seen (x to the right, y down).
void grow_lattices(const std::vector<Saddle>& saddles, cv::Size image,
                   const std::function<bool(const std::vector<LatticeNode>&)>& is_last);

}  // namespace plumbline::detail
