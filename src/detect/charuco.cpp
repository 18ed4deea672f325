// SPDX-License-Identifier: Apache-2.0
#include "detect/charuco.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "detect/charuco_strays.hpp"
#include "detect/chess_fit.hpp"
#include "detect/chess_search.hpp"
#include "detect/finders.hpp"
#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

constexpr std::size_t kMinCorners = 4;
constexpr double kMinReach = 0.8;                   ///< [px] between an edge and the markers beside it
constexpr double kMinBlurs = 1.25;                  ///< the same in blurs
constexpr double kBorderPx = 2;                     ///< of the image: corners that are nearer are not missed
constexpr double kOutside = 0.15, kFewOutside = 4;  ///< of a lattice's nodes that may lie beyond the board
constexpr int kFew = 3;  ///< markers that lie wrong before they are another board's
constexpr int kRounds = 12;
constexpr double kJoin = 0.35;  ///< of a square, for each square between two lattices

bool is_inside(const Charuco& board, const std::pair<int, int>& at) {
  return at.first >= 0 && at.second >= 0 && at.first + 1 < board.columns && at.second + 1 < board.rows;
}

/// Nodes of a lattice on the board, none where many lie beyond it.
int nodes_on_board(const SeenLattice& lattice, const BoardPlacement& placement, const Charuco& board) {
  int inside = 0;
  for (int r = 0; r < lattice.grid.rows; ++r) {
    for (int c = 0; c < lattice.grid.columns; ++c) {
      if (lattice.is_seen[static_cast<std::size_t>(r) * lattice.grid.columns + c] != 0)
        inside += is_inside(board, placement.corner_of(c, r)) ? 1 : 0;
    }
  }
  return lattice.n_seen - inside <= std::max(kFewOutside, kOutside * lattice.n_seen) ? inside : 0;
}

/// Adds a lattice's nodes to the board's corners, unless it lies elsewhere than those before it.
void join(const CharucoReading::Part& part, const BoardPlacement& placement, ChessGrid& grid) {
  ChessGrid own(grid.columns, grid.rows);
  const SeenLattice& lattice = part.lattice;
  for (int r = 0; r < lattice.grid.rows; ++r) {
    for (int c = 0; c < lattice.grid.columns; ++c) {
      if (lattice.is_seen[static_cast<std::size_t>(r) * lattice.grid.columns + c] == 0) continue;
      const auto [to_c, to_r] = placement.corner_of(c, r);
      if (to_c >= 0 && to_r >= 0 && to_c < grid.columns && to_r < grid.rows)
        own.at(to_c, to_r) = lattice.grid.at(c, r);
    }
  }
  if (grid.count() > 0) {
    // The two nodes that are nearest to each other, and the steps at both.
    int best = 1 << 20;
    Vec2 delta = Vec2::Zero(), off = Vec2::Zero();
    Mat2 J = Mat2::Zero();
    for (int i = 0; i < static_cast<int>(grid.px.size()); ++i) {
      const int c = i % grid.columns, r = i / grid.columns;
      const auto J_a = grid.at(c, r) ? steps_at(grid, c, r) : std::nullopt;
      if (!J_a) continue;
      for (int k = 0; k < static_cast<int>(own.px.size()); ++k) {
        const int dc = k % grid.columns - c, dr = k / grid.columns - r, distance = dc * dc + dr * dr;
        if (distance >= best || !own.px[static_cast<std::size_t>(k)]) continue;
        const auto J_b = steps_at(own, c + dc, r + dr);
        if (!J_b) continue;
        best = distance, delta = Vec2(dc, dr), J = (*J_a + *J_b) / 2;
        off = *own.px[static_cast<std::size_t>(k)] - *grid.at(c, r);
      }
    }
    const double limit = kJoin * std::max(1.0, delta.norm()) * std::sqrt(std::abs(J.determinant()));
    if (!((off - J * delta).norm() < limit)) return;
  }
  for (std::size_t i = 0; i < grid.px.size(); ++i) {
    if (!grid.px[i]) grid.px[i] = own.px[i];
  }
}

/// Four corners on a line say nothing about a camera.
bool spans_plane(const std::vector<Corner>& corners, int columns) {
  const auto at = [&](const Corner& c) { return Vec2(c.point % columns, c.point / columns); };
  for (std::size_t i = 2; i < corners.size(); ++i) {
    const Vec2 a = at(corners[1]) - at(corners[0]), b = at(corners[i]) - at(corners[0]);
    if (std::abs(a.x() * b.y() - a.y() * b.x()) > 0.5) return true;
  }
  return false;
}

std::vector<Corner> corners_of(const cv::Mat& grey, const Charuco& board, const ChessGrid& grid,
                               double scale) {
  std::vector<Vec2> px;
  for (const auto& p : grid.px) {
    if (p) px.push_back(*p);
  }
  const double noise = noise_level(grey, bounding_box(px, grey));
  const GridFit how{(1 - board.marker_m / board.square_m) / 2, kMinReach, kMinBlurs, kRounds};
  std::vector<Corner> out;
  for (const ChessCorner& c :
       without_odd(refine_grid(grey, grid, scale, noise, how), grid.columns, grid.rows))
    out.push_back({c.point, c.px, c.sigma_px});
  return out;
}

std::string another_one(int n_agreeing, int n_markers) {
  return fmt::format("only {} of the {} markers found lie as on this board: it is another one", n_agreeing,
                     n_markers);
}

std::string why_none(const Charuco& board, const CharucoReading& reading) {
  if (reading.n_opposed >= kFew) return another_one(reading.n_markers - reading.n_opposed, reading.n_markers);
  if (reading.n_markers == 0)
    return fmt::format("none of the {} markers of {} found", n_markers(board), board.dictionary);
  return fmt::format("{} of {} markers of {} found, at least 2 are needed to tell", reading.n_markers,
                     n_markers(board), board.dictionary);
}

/// The markers read once more through the corners that were found: more of them than a lattice had, and those
/// of another board contradict.
BoardPlacement read_again(const cv::Mat& grey, const Charuco& board, const std::vector<Corner>& corners,
                          const BoardPlacement& first, const MarkerBook& book) {
  // One place more on each side: the squares beyond the board's.
  const int w = board.columns - 1;
  ChessGrid grid(board.columns + 1, board.rows + 1);
  for (const Corner& c : corners) grid.at(c.point % w + 1, c.point / w + 1) = c.px;
  BoardPlacement out;
  out.is_legacy = first.is_legacy, out.is_negative = first.is_negative;
  out.shift_c = out.shift_r = -2;  // and one of those foretold
  count_agreeing(read_squares(grey, with_places_around(grid, 1), board, book), board, out);
  return out;
}

CharucoReading read_level(LatticePyramid& pyramid, int level, const Charuco& board, const MarkerBook& book) {
  const bool has_legacy = board.rows % 2 == 0 && board.layout != Charuco::Layout::kCurrent;
  const bool has_current = board.rows % 2 != 0 || board.layout != Charuco::Layout::kLegacy;
  CharucoReading out;
  for (const SeenLattice& lattice : pyramid.level(level)) {
    const auto squares = read_squares(pyramid.grey(), lattice, board, book);
    if (squares.empty()) continue;
    CharucoReading::Part part{lattice, {}, {}};
    if (has_current) part.current = place_on_board(squares, board, false);
    if (has_legacy) part.legacy = place_on_board(squares, board, true);
    for (BoardPlacement* p : {&part.current, &part.legacy})
      p->is_sure = p->is_sure && nodes_on_board(lattice, *p, board) > 0;
    const int agreeing = std::max(part.current.agreeing, part.legacy.agreeing);
    const auto clear = std::count_if(squares.begin(), squares.end(), [](auto& s) { return s.is_clear; });
    const int markers = std::max(static_cast<int>(clear), agreeing);
    if (markers > out.n_markers) out.n_markers = markers, out.n_opposed = markers - agreeing;
    if (!part.current.is_sure && !part.legacy.is_sure) continue;
    if (has_open_layout(board)) out.layout_vote += part.current.agreeing - part.legacy.agreeing;
    out.parts.push_back(std::move(part));
  }
  return out;
}

/// Whether all corners that are missing lie outside of the image, as those beside them say; few scattered
/// corners say nothing.
bool is_whole(const Detection& found, const Charuco& board, cv::Size image) {
  ChessGrid grid(board.columns - 1, board.rows - 1);
  for (const Corner& c : found.corners) grid.px[static_cast<std::size_t>(c.point)] = c.px;
  if (grid.count() == static_cast<int>(grid.px.size())) return true;
  bool is_foretold = false;
  for (int i = 0; i < static_cast<int>(grid.px.size()) && !is_foretold; ++i)
    is_foretold = !grid.px[static_cast<std::size_t>(i)] && foretold(grid, i % grid.columns, i / grid.columns);
  return is_foretold && is_all_in_sight(grid, image, kBorderPx);
}

}  // namespace

CharucoFind find_charuco(LatticePyramid& pyramid, const Charuco& board) {
  const MarkerBook book = marker_book(board.dictionary);
  const cv::Mat& grey = pyramid.grey();
  CharucoFind best;
  for (int k = 0; k < pyramid.n_levels(); ++k) {
    CharucoFind here;
    here.reading = read_level(pyramid, k, board, book);
    const bool is_legacy = board.rows % 2 == 0 && (board.layout == Charuco::Layout::kLegacy ||
                                                   (has_open_layout(board) && here.reading.layout_vote < 0));
    here.detection = charuco_from_reading(grey, board, here.reading, book, is_legacy);
    const std::size_t n = here.detection.corners.size(), n_best = best.detection.corners.size();
    const bool is_better = n != n_best ? n > n_best : here.reading.n_markers > best.reading.n_markers;
    if (k == 0 || is_better) best = std::move(here);
    if (is_whole(best.detection, board, grey.size())) break;
  }
  return best;
}

std::optional<Target> with_layout(const Target& target, Charuco::Layout layout) {
  Target out = target;
  bool is_open = false;
  const auto set = [&](TargetSpec& spec) {
    auto* charuco = std::get_if<Charuco>(&spec);
    if (charuco == nullptr || !has_open_layout(*charuco)) return;
    charuco->layout = layout;
    is_open = true;
  };
  set(out.spec);
  if (auto* rig = std::get_if<BoardRig>(&out.spec)) {
    for (BoardPart& part : rig->parts) set(part.board);
  }
  return is_open ? std::optional<Target>(std::move(out)) : std::nullopt;
}

Detection charuco_from_reading(const cv::Mat& grey, const Charuco& board, const CharucoReading& reading,
                               const MarkerBook& book, bool is_legacy) {
  Detection out;
  out.layout_vote = reading.layout_vote;
  ChessGrid grid(board.columns - 1, board.rows - 1);
  double scale = 1;
  int n_read = 0;
  const BoardPlacement* first = nullptr;
  for (const CharucoReading::Part& part : reading.parts) {
    const BoardPlacement& placement = is_legacy ? part.legacy : part.current;
    if (!placement.is_sure) continue;
    if (first == nullptr) first = &placement;
    join(part, placement, grid);
    scale = part.lattice.scale;
    n_read += placement.agreeing;
  }
  if (first == nullptr) {
    out.reason = why_none(board, reading);
    return out;
  }
  out.corners = corners_of(grey, board, grid, scale);
  if (out.corners.size() < kMinCorners || !spans_plane(out.corners, board.columns - 1)) {
    out.reason = fmt::format(
        "{} of {} corners found (from {} of {} markers), at least {} that are not on one line are needed",
        out.corners.size(), (board.columns - 1) * (board.rows - 1), n_read, n_markers(board), kMinCorners);
    out.corners.clear();
    return out;
  }
  const BoardPlacement again = read_again(grey, board, out.corners, *first, book);
  if (!is_uncontested(again)) {
    out.reason = another_one(again.agreeing, again.agreeing + again.opposed);
    out.corners.clear();
    return out;
  }
  out.method = fmt::format("markers{}, saddle fit", board.rows % 2 != 0 ? ""
                                                    : is_legacy         ? ", layout legacy"
                                                                        : ", layout current");
  return out;
}

Detection detect_charuco(const cv::Mat& grey, const Charuco& board) {
  LatticePyramid pyramid(grey);
  return find_charuco(pyramid, board).detection;
}

}  // namespace plumbline::detail
