// SPDX-License-Identifier: Apache-2.0
#include "detect/charuco_lattice.hpp"

#include <algorithm>
#include <cmath>

#include "detect/pyramid.hpp"
#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

/// Images are halved until no side is longer than this: blur, noise and the insides of markers fade with
/// them.
constexpr int kCoarsest = 500;
constexpr int kMostSaddles = 4000;
/// Saddles along an edge: those of a marker stand beside it. Seen aslant, edges lie far from where smoothed
/// curvatures say.
constexpr int kTries = 4;
constexpr double kCone = 0.65;
constexpr int kLeastBox = 2, kMostLattices = 60;
constexpr double kLeastShare = 0.3;  ///< of its box that a lattice fills
/// Beside an edge [of its length, px]: inside of the white around a marker.
constexpr double kBeside = 0.06, kLeastBeside = 1.2;
constexpr double kLeastStep = 0.3;  ///< across an edge, of the largest along it

/// Whether one side of the line between two saddles is darker than the other all along it: the outline of a
/// square is, a line through a marker is not.
bool is_edge(const cv::Mat& image, const Saddle& a, const Saddle& b) {
  const Vec2 along = b.px - a.px;
  const double length = along.norm();
  const Vec2 beside = Vec2(-along.y(), along.x()) / length * std::max(kLeastBeside, kBeside * length);
  double low = 1e9, high = -1e9;
  for (const double t : {0.25, 0.4, 0.6, 0.75}) {
    const Vec2 p = a.px + t * along;
    const double step = sample(image, p + beside) - sample(image, p - beside);
    low = std::min(low, step), high = std::max(high, step);
  }
  if (low < 0 && high > 0) return false;
  const double least = std::min(std::abs(low), std::abs(high)),
               most = std::max(std::abs(low), std::abs(high));
  return most > 4 && least > kLeastStep * most;
}

std::optional<SeenLattice> seen_lattice(const std::vector<LatticeNode>& nodes,
                                        const std::vector<Saddle>& saddles, const Vec2& ratio, double scale) {
  int i0 = 1 << 20, i1 = -i0, j0 = i0, j1 = -i0;
  for (const LatticeNode& n : nodes) {
    i0 = std::min(i0, n.i), i1 = std::max(i1, n.i);
    j0 = std::min(j0, n.j), j1 = std::max(j1, n.j);
  }
  if (static_cast<double>(nodes.size()) < kLeastShare * (i1 - i0 + 1) * (j1 - j0 + 1)) return std::nullopt;
  ChessGrid grid(i1 - i0 + 1, j1 - j0 + 1);
  for (const LatticeNode& n : nodes) {
    const Vec2& p = saddles[static_cast<std::size_t>(n.saddle)].px;
    grid.at(n.i - i0, n.j - j0) = (p + Vec2(0.5, 0.5)).cwiseProduct(ratio) - Vec2(0.5, 0.5);
  }
  return with_places_around(grid, scale);
}

}  // namespace

SeenLattice with_places_around(const ChessGrid& seen, double scale) {
  SeenLattice out;
  out.grid = ChessGrid(seen.columns + 2, seen.rows + 2);
  out.scale = scale;
  out.n_seen = seen.count();
  for (int r = 0; r < seen.rows; ++r) {
    for (int c = 0; c < seen.columns; ++c) out.grid.at(c + 1, r + 1) = seen.at(c, r);
  }
  for (const auto& p : out.grid.px) out.is_seen.push_back(p ? 1 : 0);
  // What was foretold foretells the next.
  for (int round = 0; round < 2; ++round) {
    const ChessGrid before = out.grid;
    for (int r = 0; r < out.grid.rows; ++r) {
      for (int c = 0; c < out.grid.columns; ++c) {
        if (!before.at(c, r)) out.grid.at(c, r) = foretold(before, c, r);
      }
    }
  }
  return out;
}

LatticePyramid::LatticePyramid(const cv::Mat& grey)
    : images_(pyramid_of(grey, kCoarsest)), levels_(images_.size()) {}

const std::vector<SeenLattice>& LatticePyramid::level(int k) {
  auto& level = levels_[static_cast<std::size_t>(k)];
  if (level) return *level;
  level.emplace();
  const cv::Mat& image = images_[static_cast<std::size_t>(k)];
  const Vec2 ratio = Vec2::Constant(pyramid_ratio(images_.size(), static_cast<std::size_t>(k)));
  const double noise = noise_level(image, {0, 0, image.cols, image.rows});
  const auto saddles = find_saddles(image, noise, kMostSaddles);
  LatticeRules rules;
  rules.most_tries = kTries, rules.cone = kCone, rules.least_box = kLeastBox,
  rules.most_lattices = kMostLattices;
  rules.is_edge = [&](const Saddle& a, const Saddle& b) { return is_edge(image, a, b); };
  grow_lattices(
      saddles, image.size(),
      [&](const std::vector<LatticeNode>& nodes) {
        if (auto lattice = seen_lattice(nodes, saddles, ratio, 1 / ratio.x()))
          level->push_back(std::move(*lattice));
        return false;
      },
      rules);
  std::stable_sort(level->begin(), level->end(),
                   [](const SeenLattice& a, const SeenLattice& b) { return a.n_seen > b.n_seen; });
  return *level;
}

}  // namespace plumbline::detail
