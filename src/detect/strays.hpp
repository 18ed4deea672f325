// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <vector>

#include "plumbline/core/types.hpp"

/// Corners checked against their neighbours: a corner that was refined onto another feature lies elsewhere
/// than the corners around it say.
namespace plumbline::detail {

/// A corner that was refined: its point's number, its place on the board (in tags or squares) and in the
/// image.
struct Refined {
  int point;
  Vec2 board, px;
  double sigma;
};

/// A place in the image as foretold by corners nearby.
struct Prediction {
  Vec2 px;
  Mat2 J;  ///< d px / d board
};

/// Where `at` should be by the refined corners nearest to it (`skip` is not one): their homography, and a
/// quadratic for what it leaves, since on a wide lens neighbouring tags differ by pixels from any plane.
std::optional<Prediction> predict(const std::vector<Refined>& all, const Vec2& at, int skip);

/// Without the corners that lie elsewhere than their neighbours say. A stray spoils the predictions around
/// it, so only the worst of a neighbourhood goes in each round. `limit` [px]: what stands out from the median
/// error; 0 is replaced by that, once, since the median of what is left would sink from round to round and
/// take good corners with it.
std::vector<Refined> without_strays(std::vector<Refined> corners, double& limit);

}  // namespace plumbline::detail
