// SPDX-License-Identifier: Apache-2.0
#include "detect/charuco_strays.hpp"

#include <algorithm>
#include <cmath>

#include "detect/chess_grid.hpp"
#include "detect/median.hpp"

namespace plumbline::detail {
namespace {

/// How far off a corner has to be: pixels, own sigmas, and times of what is usual.
constexpr double kRoughPx = 0.1, kLeastPx = 0.6, kSigmas = 5, kUsuals = 8;
/// A wide lens bends the rim of a board by more than a line foretells, and the lines beside it alike: so many
/// times what they are off at the same place is not odd, but for corners that their fits call rough.
constexpr double kBeside = 2.5;

/// How far a corner is from where one of its lines has it; nullopt where too few neighbours are known.
std::optional<double> off_line(const ChessGrid& grid, int c, int r, int dc, int dr) {
  const auto get = [&](int k) { return grid.get(c + k * dc, r + k * dr); };
  if (!grid.get(c, r)) return std::nullopt;
  const Vec2 here = *grid.at(c, r);
  const auto a = get(-1), b = get(1), aa = get(-2), bb = get(2);
  if (a && b && aa && bb) return ((4 * (*a + *b) - (*aa + *bb)) / 6 - here).norm();
  for (const int way : {1, -1}) {
    const auto p = get(way), q = get(2 * way), s = get(3 * way), before = get(-way);
    if (p && q && before) return (*before / 3 + *p - *q / 3 - here).norm();
    if (p && q && s) return (3 * *p - 3 * *q + *s - here).norm();
  }
  return std::nullopt;
}

/// How much farther a corner is off than the lines beside it are; 0 where nothing foretells it.
double oddness(const ChessGrid& grid, const ChessCorner& corner, double beside) {
  const int c = corner.point % grid.columns, r = corner.point / grid.columns;
  std::optional<double> least;
  for (const auto& [dc, dr] : {std::pair{1, 0}, {0, 1}}) {
    auto off = off_line(grid, c, r, dc, dr);
    if (!off) continue;
    double others = 0;
    for (const int side : {1, -1})
      others = std::max(others, off_line(grid, c + side * dr, r + side * dc, dc, dr).value_or(0));
    *off -= beside * others;
    least = std::min(*off, least.value_or(*off));
  }
  return least.value_or(0);
}

}  // namespace

std::vector<ChessCorner> without_odd(std::vector<ChessCorner> corners, int columns, int rows) {
  ChessGrid grid(columns, rows);
  for (const ChessCorner& c : corners) grid.px[static_cast<std::size_t>(c.point)] = c.px;
  std::vector<double> all;
  for (const ChessCorner& c : corners) all.push_back(oddness(grid, c, 0));
  const double usual = median(std::move(all));  // once: it would sink and take good corners with it
  while (true) {
    double worst = 1;
    auto odd = corners.end();
    for (auto it = corners.begin(); it != corners.end(); ++it) {
      const double here = oddness(grid, *it, it->sigma_px > kRoughPx ? 0 : kBeside) /
                          std::max({kLeastPx, kUsuals * usual, kSigmas * it->sigma_px});
      if (here > worst) worst = here, odd = it;
    }
    if (odd == corners.end()) return corners;
    grid.px[static_cast<std::size_t>(odd->point)].reset();
    corners.erase(odd);
  }
}

}  // namespace plumbline::detail
