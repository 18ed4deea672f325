// SPDX-License-Identifier: Apache-2.0
#include "detect/chess_search.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "detect/median.hpp"
#include "detect/pyramid.hpp"
#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

/// Images are halved until no side is longer than this: blur and noise shrink with them.
constexpr int kCoarsest = 500;
/// A step between neighbouring fields that is so much smaller than most counts as none; so many of them may
/// be (glare, marks inside of squares).
constexpr double kWeakField = 0.2, kWeakFields = 0.08;
constexpr double kMuchMore = 1.3;  ///< nodes of a lattice that was refused
constexpr double kFaint = 0.35;    ///< of the strength of a lattice's weakest node

/// Mean grey level inside the field between four corners.
std::optional<double> field(const cv::Mat& grey, const ChessGrid& grid, int c, int r) {
  const auto a = grid.get(c, r), b = grid.get(c + 1, r), d = grid.get(c, r + 1), e = grid.get(c + 1, r + 1);
  if (!a || !b || !d || !e) return std::nullopt;
  double sum = 0;
  for (const double u : {0.3, 0.5, 0.7}) {
    for (const double v : {0.3, 0.5, 0.7})
      sum += sample(grey, (1 - v) * ((1 - u) * *a + u * *b) + v * ((1 - u) * *d + u * *e));
  }
  return sum / 9;
}

/// Whether the fields are bright and dark in turn: saddles of other things may lie in rows, but do not bound
/// fields of two colours.
bool fields_alternate(const cv::Mat& grey, const ChessGrid& grid) {
  std::vector<double> steps;
  for (int r = 0; r + 1 < grid.rows; ++r) {
    for (int c = 0; c + 1 < grid.columns; ++c) {
      const auto here = field(grey, grid, c, r);
      if (!here) continue;
      for (const auto& next : {field(grey, grid, c + 1, r), field(grey, grid, c, r + 1)}) {
        if (next) steps.push_back((*next - *here) * ((c + r) % 2 == 0 ? 1 : -1));
      }
    }
  }
  if (steps.size() < 4) return false;
  const double middle = median(steps);
  const auto weak =
      std::count_if(steps.begin(), steps.end(), [&](double s) { return s / middle < kWeakField; });
  return std::abs(middle) > 4 && static_cast<double>(weak) <= kWeakFields * static_cast<double>(steps.size());
}

/// Whether two grids share corners: two lattices of one board, not two boards.
bool overlap(const ChessGrid& a, const ChessGrid& b, double near_px) {
  return std::any_of(a.px.begin(), a.px.end(), [&](const auto& p) {
    return p && std::any_of(b.px.begin(), b.px.end(),
                            [&](const auto& q) { return q && (*p - *q).norm() < near_px; });
  });
}

/// The largest lattice that was no board: what a finer level sees of it is none either.
struct Refused {
  std::vector<Vec2> px;  ///< of the whole image
  void add(const std::vector<LatticeNode>& nodes, const std::vector<Saddle>& saddles, double ratio) {
    if (nodes.size() <= px.size()) return;
    px.clear();
    for (const LatticeNode& n : nodes)
      px.emplace_back((saddles[static_cast<std::size_t>(n.saddle)].px + Vec2(0.5, 0.5)) * ratio -
                      Vec2(0.5, 0.5));
  }
  /// Whether a grid of the image's level lies within it and has much less of it.
  bool is_part(const ChessGrid& grid, double ratio) const {
    if (static_cast<double>(px.size()) < kMuchMore * grid.count()) return false;
    int shared = 0;
    for (const auto& p : grid.px) {
      if (!p) continue;
      const Vec2 at = (*p + Vec2(0.5, 0.5)) * ratio - Vec2(0.5, 0.5);
      shared += std::any_of(px.begin(), px.end(), [&](const Vec2& q) { return (q - at).norm() < 6 * ratio; })
                    ? 1
                    : 0;
    }
    return 2 * shared > grid.count();
  }
};

/// Diagonal of the box around the corners.
double extent(const ChessGrid& grid) {
  Vec2 low = Vec2::Constant(1e30), high = Vec2::Constant(-1e30);
  for (const auto& p : grid.px) {
    if (p) low = low.cwiseMin(*p), high = high.cwiseMax(*p);
  }
  return (high - low).norm();
}

/// Whether there are enough saddles as strong as those of a lattice for a second board.
bool has_room_for_another(const std::vector<Saddle>& saddles, const std::vector<LatticeNode>& nodes) {
  double weakest = 1e30;
  for (const LatticeNode& n : nodes)
    weakest = std::min(weakest, saddles[static_cast<std::size_t>(n.saddle)].strength);
  const auto n = std::count_if(saddles.begin(), saddles.end(),
                               [&](const Saddle& s) { return s.strength > kFaint * weakest; });
  return static_cast<std::size_t>(n) >= 2 * nodes.size();
}

}  // namespace

bool is_all_in_sight(const ChessGrid& grid, cv::Size image, double border_px) {
  for (int r = 0; r < grid.rows; ++r) {
    for (int c = 0; c < grid.columns; ++c) {
      if (grid.at(c, r)) continue;
      const auto px = foretold(grid, c, r);
      if (px && px->x() > border_px && px->y() > border_px && px->x() < image.width - 1 - border_px &&
          px->y() < image.height - 1 - border_px)
        return false;
    }
  }
  return true;
}

ChessSearch search_chessboard(const cv::Mat& grey, const Chessboard& board) {
  ChessSearch out;
  const int all = board.columns * board.rows;
  const auto pyramid = pyramid_of(grey, kCoarsest);
  Refused refused;
  for (std::size_t level = 0; level < pyramid.size(); ++level) {
    const cv::Mat& image = pyramid[level];
    const double ratio = pyramid_ratio(pyramid.size(), level);
    const double noise = noise_level(image, {0, 0, image.cols, image.rows});
    const auto saddles = find_saddles(image, noise, 20 * all + 1000);
    std::size_t largest = 0;
    grow_lattices(saddles, image.size(), [&](const std::vector<LatticeNode>& nodes) {
      auto placed = place_lattice(nodes, saddles, board, image.size());
      if (auto* why = std::get_if<std::string>(&placed)) {
        if (nodes.size() > largest) out.reason = std::move(*why);
        largest = std::max(largest, nodes.size());
        refused.add(nodes, saddles, ratio);
        return false;
      }
      auto& grid = std::get<ChessGrid>(placed);
      if (grid.count() < all && refused.is_part(grid, ratio)) {
        out.reason = fmt::format("part of a larger board than {}x{}", board.columns, board.rows);
        return false;
      }
      const bool is_worth_a_look = grid.count() > out.grid.count() || 2 * grid.count() > all;
      if (!is_worth_a_look || !fields_alternate(image, grid)) return false;
      for (auto& p : grid.px) {
        if (p) p = (*p + Vec2(0.5, 0.5)) * ratio - Vec2(0.5, 0.5);
      }
      if (grid.count() == all && out.grid.count() == all && !overlap(grid, out.grid, 3 * ratio)) {
        // One on a screen or a poster in the background is not the one that is held up.
        const double ratio_of_sizes = extent(grid) / extent(out.grid);
        out.is_twice = ratio_of_sizes > 0.5 && ratio_of_sizes < 2;
        if (ratio_of_sizes >= 2) out.grid = grid, out.scale = 1 / ratio;
      }
      if (grid.count() > out.grid.count()) {
        out.grid = std::move(grid);
        out.scale = 1 / ratio;
      }
      return out.is_twice || (out.grid.count() == all && !has_room_for_another(saddles, nodes));
    });
    if (out.grid.count() > 0 && is_all_in_sight(out.grid, grey.size(), kBorderPx / out.scale)) break;
  }
  return out;
}

}  // namespace plumbline::detail
