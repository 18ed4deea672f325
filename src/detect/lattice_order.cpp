// SPDX-License-Identifier: Apache-2.0
#include "detect/lattice_order.hpp"

#include <algorithm>
#include <array>
#include <limits>

namespace plumbline::detail {
namespace {

/// How a numbering can differ: rows reversed, columns reversed, rows and columns exchanged.
LatticePoints renumbered(const LatticePoints& points, bool flip_c, bool flip_r, bool transpose) {
  LatticePoints out{points.columns, points.rows, {}};
  for (int r = 0; r < points.rows; ++r) {
    for (int c = 0; c < points.columns; ++c) {
      const int c1 = transpose ? r : c, r1 = transpose ? c : r;
      out.px.push_back(points.at(flip_c ? points.columns - 1 - c1 : c1, flip_r ? points.rows - 1 - r1 : r1));
    }
  }
  return out;
}

double cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

/// > 0 when x turned clockwise (as seen) gives y, as on a board seen from its front.
double handedness(const LatticePoints& points) {
  double sum = 0;
  for (int r = 0; r + 1 < points.rows; ++r)
    for (int c = 0; c + 1 < points.columns; ++c)
      sum += cross(points.at(c + 1, r) - points.at(c, r), points.at(c, r + 1) - points.at(c, r));
  return sum;
}

}  // namespace

std::optional<LatticePoints> orient(const LatticePoints& points,
                                    const std::function<bool(const LatticePoints&)>& allows) {
  std::optional<LatticePoints> best;
  double best_place = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 8; ++k) {
    if ((k & 4) != 0 && points.columns != points.rows) break;
    LatticePoints candidate = renumbered(points, (k & 1) != 0, (k & 2) != 0, (k & 4) != 0);
    if (!(handedness(candidate) > 0) || !allows(candidate)) continue;
    const double place = candidate.px.front().sum() - candidate.px.back().sum();
    if (place < best_place) {
      best_place = place;
      best = std::move(candidate);
    }
  }
  return best;
}

}  // namespace plumbline::detail
