// SPDX-License-Identifier: Apache-2.0
#include "detect/chess_grid.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "detect/chess_ends.hpp"

namespace plumbline::detail {
namespace {

constexpr double kHoles = 0.15;      ///< share of the corners in the box of those found that may be missing
constexpr double kMinShare = 0.2;    ///< of the board that has to be seen
constexpr int kMinPart = 20;         ///< corners of a part: texture makes lattices of a few
constexpr double kSparseRim = 0.35;  ///< a rim of the lattice with fewer of its nodes is no part of the board

double cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Through p1 and p2 to the third; with p0 before them, steps go on changing as they did.
Vec2 onward(const std::optional<Vec2>& p0, const Vec2& p1, const Vec2& p2) {
  const Vec2 step = p2 - p1;
  return p2 + (p0 ? Vec2(step + 0.7 * (step - (p1 - *p0))) : step);
}

struct Box {
  int i0 = 0, i1 = -1, j0 = 0, j1 = -1;
  int width() const { return i1 - i0 + 1; }
  int height() const { return j1 - j0 + 1; }
};

Box box_of(const std::vector<LatticeNode>& nodes) {
  Box box{1 << 20, -(1 << 20), 1 << 20, -(1 << 20)};
  for (const LatticeNode& n : nodes) {
    box.i0 = std::min(box.i0, n.i), box.i1 = std::max(box.i1, n.i);
    box.j0 = std::min(box.j0, n.j), box.j1 = std::max(box.j1, n.j);
  }
  return box;
}

/// Without rims that hold only a few nodes, as long as the lattice is larger than the board.
std::vector<LatticeNode> trimmed(std::vector<LatticeNode> nodes, int longer, int shorter) {
  while (true) {
    const Box box = box_of(nodes);
    const int w = box.width(), h = box.height();
    if (nodes.empty() || (std::max(w, h) <= longer && std::min(w, h) <= shorter)) return nodes;
    struct Rim {
      double share;
      bool is_column;
      int at;
    };
    std::vector<Rim> rims;
    for (const auto& [is_column, at] :
         {std::pair{true, box.i0}, {true, box.i1}, {false, box.j0}, {false, box.j1}}) {
      const auto on_rim = [&, c = is_column, a = at](const LatticeNode& n) { return (c ? n.i : n.j) == a; };
      const auto n = std::count_if(nodes.begin(), nodes.end(), on_rim);
      rims.push_back({static_cast<double>(n) / (is_column ? h : w), is_column, at});
    }
    const Rim least = *std::min_element(rims.begin(), rims.end(),
                                        [](const Rim& a, const Rim& b) { return a.share < b.share; });
    if (least.share > kSparseRim) return nodes;
    std::erase_if(nodes, [&](const LatticeNode& n) { return (least.is_column ? n.i : n.j) == least.at; });
  }
}

/// One way to number the lattice.
struct Placement {
  ChessGrid grid;
  int agreeing = 0, opposed = 0;  ///< nodes whose colours are those of the board, and others
  int holes = 0;                  ///< corners that are missing between others
  bool is_whole = false;          ///< as wide and high as the board
};

/// (i, j) turned by quarter turns.
std::pair<int, int> turned(int i, int j, int quarters) {
  for (int k = 0; k < quarters; ++k) i = std::exchange(j, i), i = -i;
  return {i, j};
}

/// Whether the square up and to the left of a corner is dark.
bool is_dark_before(const Saddle& saddle, const Mat2& steps) {
  const Vec2 x = steps.col(0).normalized(), y = steps.col(1).normalized();
  return std::abs(saddle.bright.dot((x - y).normalized())) >
         std::abs(saddle.bright.dot((x + y).normalized()));
}

bool is_outside(const Vec2& p, cv::Size image) {
  return p.x() < kBorderPx || p.y() < kBorderPx || p.x() > image.width - 1 - kBorderPx ||
         p.y() > image.height - 1 - kBorderPx;
}

/// Whether every missing corner beside a known one is out of sight, but for holes.
bool ends_are_right(Placement& placement, const Box& box, cv::Size image) {
  const ChessGrid& grid = placement.grid;
  for (int r = 0; r < grid.rows; ++r) {
    for (int c = 0; c < grid.columns; ++c) {
      if (grid.at(c, r)) continue;
      const auto expected = foretold(grid, c, r);
      if (!expected || is_outside(*expected, image)) continue;
      if (c < box.i0 || c > box.i1 || r < box.j0 || r > box.j1) return false;
      ++placement.holes;
    }
  }
  return placement.holes <= kHoles * grid.count();
}

std::vector<Placement> placements(const std::vector<LatticeNode>& nodes, const std::vector<Saddle>& saddles,
                                  const Chessboard& board, cv::Size image) {
  std::vector<Placement> out;
  for (int quarters = 0; quarters < 4; ++quarters) {
    std::vector<LatticeNode> ours = nodes;
    for (LatticeNode& n : ours) std::tie(n.i, n.j) = turned(n.i, n.j, quarters);
    const Box box = box_of(ours);
    for (int c0 = 0; c0 + box.width() <= board.columns; ++c0) {
      for (int r0 = 0; r0 + box.height() <= board.rows; ++r0) {
        Placement p{ChessGrid(board.columns, board.rows)};
        for (const LatticeNode& n : ours)
          p.grid.at(n.i - box.i0 + c0, n.j - box.j0 + r0) = saddles[static_cast<std::size_t>(n.saddle)].px;
        p.is_whole = box.width() == board.columns && box.height() == board.rows;
        for (const LatticeNode& n : ours) {
          const int c = n.i - box.i0 + c0, r = n.j - box.j0 + r0;
          const auto steps = steps_at(p.grid, c, r);
          if (!steps) continue;
          const bool dark = is_dark_before(saddles[static_cast<std::size_t>(n.saddle)], *steps);
          ++(dark == ((c + r) % 2 == 0) ? p.agreeing : p.opposed);
        }
        const Box placed{c0, c0 + box.width() - 1, r0, r0 + box.height() - 1};
        if (ends_are_right(p, placed, image)) out.push_back(std::move(p));
      }
    }
  }
  return out;
}

/// How far the numbering runs to the right and down in the image.
double runs_down(const ChessGrid& grid) {
  const auto &first = grid.px.front(), &last = grid.px.back();
  if (first && last) return last->sum() - first->sum();
  double sum = 0;
  for (int r = 0; r < grid.rows; ++r) {
    for (int c = 0; c < grid.columns; ++c) {
      if (const auto& p = grid.at(c, r)) sum += p->sum() * (c + r - 0.5 * (grid.columns + grid.rows - 2));
    }
  }
  return sum;
}

}  // namespace

int ChessGrid::count() const {
  return static_cast<int>(std::count_if(px.begin(), px.end(), [](const auto& p) { return p.has_value(); }));
}

std::optional<Vec2> foretold(const ChessGrid& grid, int c, int r) {
  Vec2 sum = Vec2::Zero();
  int n = 0;
  for (const auto& [dc, dr] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
    const auto one = grid.get(c + dc, r + dr), two = grid.get(c + 2 * dc, r + 2 * dr);
    if (!one || !two) continue;
    if (const auto opposite = grid.get(c - dc, r - dr)) return Vec2((*one + *opposite) / 2);
    sum += onward(grid.get(c + 3 * dc, r + 3 * dr), *two, *one);
    ++n;
  }
  if (n > 0) return Vec2(sum / n);
  for (const auto& [dc, dr] : {std::pair{1, 1}, {1, -1}, {-1, 1}, {-1, -1}}) {
    const auto a = grid.get(c + dc, r), b = grid.get(c, r + dr), d = grid.get(c + dc, r + dr);
    if (a && b && d) return Vec2(*a + *b - *d);
  }
  return std::nullopt;
}

namespace {

/// The step in direction (dc, dr) of the row or column beside the one through (c, r).
std::optional<Vec2> step_beside(const ChessGrid& grid, int c, int r, int dc, int dr) {
  for (const int side : {1, -1}) {
    const int c1 = c + side * dr, r1 = r + side * dc;
    const auto here = grid.get(c1, r1), before = grid.get(c1 - dc, r1 - dr),
               after = grid.get(c1 + dc, r1 + dr);
    if (here && after) return Vec2(*after - *here);
    if (here && before) return Vec2(*here - *before);
  }
  return std::nullopt;
}

}  // namespace

std::optional<Mat2> steps_at(const ChessGrid& grid, int c, int r) {
  Mat2 J;
  for (int axis = 0; axis < 2; ++axis) {
    const int dc = axis == 0 ? 1 : 0, dr = 1 - dc;
    const auto before = grid.get(c - dc, r - dr), after = grid.get(c + dc, r + dr);
    const auto here = grid.get(c, r);
    if (before && after) {
      J.col(axis) = (*after - *before) / 2;
    } else if (here && after) {
      J.col(axis) = *after - *here;
    } else if (here && before) {
      J.col(axis) = *here - *before;
    } else if (const auto step = step_beside(grid, c, r, dc, dr)) {
      J.col(axis) = *step;
    } else {
      return std::nullopt;
    }
  }
  return J;
}

Vec2 curvature_at(const ChessGrid& grid, int c, int r) {
  Vec2 out = Vec2::Zero();
  for (int axis = 0; axis < 2; ++axis) {
    const int dc = axis == 0 ? 1 : 0, dr = 1 - dc;
    // At an end of a line the bend is taken from the corners before it.
    for (const int shift : {0, 1, -1}) {
      const auto a = grid.get(c + (shift - 1) * dc, r + (shift - 1) * dr);
      const auto b = grid.get(c + shift * dc, r + shift * dr);
      const auto d = grid.get(c + (shift + 1) * dc, r + (shift + 1) * dr);
      if (!a || !b || !d) continue;
      const Vec2 along = (*d - *a) / 2, bend = *a + *d - 2 * *b;
      out[axis] = cross(along, bend) / (along.norm() * along.squaredNorm());
      break;
    }
  }
  return out;
}

std::variant<ChessGrid, std::string> place_lattice(const std::vector<LatticeNode>& all,
                                                   const std::vector<Saddle>& saddles,
                                                   const Chessboard& board, cv::Size image) {
  const int longer = std::max(board.columns, board.rows), shorter = std::min(board.columns, board.rows);
  const auto nodes = trimmed(all, longer, shorter);
  if (nodes.size() < 9 || static_cast<double>(nodes.size()) < kMinShare * board.columns * board.rows)
    return fmt::format("{} of {} corners found", nodes.size(), board.columns * board.rows);
  const Box box = box_of(nodes);
  auto found = placements(nodes, saddles, board, image);
  // Boards that do not tell their ends apart by colour are also shown with their colours exchanged.
  const auto agrees = [](const Placement& p) { return p.agreeing > p.opposed; };
  const bool needs_colours =
      !is_half_turn_symmetric(board) || std::any_of(found.begin(), found.end(), agrees);
  if (needs_colours) std::erase_if(found, [&](const Placement& p) { return !agrees(p); });
  if (found.empty()) {
    return fmt::format("a lattice of {}x{} corners that do not end where the board's do", box.width(),
                       box.height());
  }
  if (static_cast<int>(nodes.size()) < kMinPart)
    std::erase_if(found, [](const Placement& p) { return !p.is_whole; });
  if (found.empty())
    return fmt::format("{} of {} corners found, too few to tell a part of a board", nodes.size(),
                       board.columns * board.rows);
  if (!has_even_steps(found[0].grid))
    return fmt::format("a lattice of {}x{} corners that are not evenly spaced", box.width(), box.height());
  if (found.size() == 1) return found[0].grid;
  if (std::any_of(found.begin(), found.end(), [](const Placement& p) { return !p.is_whole; }))
    return fmt::format("{} of {} corners found, and nothing tells which", nodes.size(),
                       board.columns * board.rows);
  return std::max_element(
             found.begin(), found.end(),
             [](const Placement& a, const Placement& b) { return runs_down(a.grid) < runs_down(b.grid); })
      ->grid;
}

}  // namespace plumbline::detail
