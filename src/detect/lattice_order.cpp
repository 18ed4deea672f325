// SPDX-License-Identifier: Apache-2.0
#include "detect/lattice_order.hpp"

#include <fmt/format.h>

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

constexpr double kMidwayTolerance = 0.3;

bool is_midway(const Vec2& a, const Vec2& b, const Vec2& c) {
  return ((a + c) / 2 - b).norm() < kMidwayTolerance * (c - a).norm() / 2;
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

std::optional<std::string> broken_lattice(const LatticePoints& points) {
  int off = 0, turned = 0;
  const double hand = handedness(points);
  for (int r = 0; r < points.rows; ++r) {
    for (int c = 0; c < points.columns; ++c) {
      if (c > 0 && c + 1 < points.columns &&
          !is_midway(points.at(c - 1, r), points.at(c, r), points.at(c + 1, r)))
        ++off;
      if (r > 0 && r + 1 < points.rows &&
          !is_midway(points.at(c, r - 1), points.at(c, r), points.at(c, r + 1)))
        ++off;
      if (c + 1 < points.columns && r + 1 < points.rows &&
          cross(points.at(c + 1, r) - points.at(c, r), points.at(c, r + 1) - points.at(c, r)) * hand <= 0) {
        ++turned;
      }
    }
  }
  if (off == 0 && turned == 0) return std::nullopt;
  return fmt::format("{} points are not between their neighbours and {} cells are turned over", off, turned);
}

double neighbour_distance(const LatticePoints& points, int c, int r) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const auto& [dc, dr] :
       {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {1, -1}, {-1, 1}, {-1, -1}}) {
    if (c + dc < 0 || c + dc >= points.columns || r + dr < 0 || r + dr >= points.rows) continue;
    nearest = std::min(nearest, (points.at(c + dc, r + dr) - points.at(c, r)).norm());
  }
  return nearest;
}

}  // namespace plumbline::detail
