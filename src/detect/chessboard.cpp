// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>

#include "detect/chess_ends.hpp"
#include "detect/chess_fit.hpp"
#include "detect/chess_search.hpp"
#include "detect/finders.hpp"
#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

/// Of the contrast; photographs of screens and much noise reach 0.3.
constexpr double kMostMisfit = 0.45;

Detection found(const std::vector<ChessCorner>& corners, const char* method) {
  Detection out;
  for (const ChessCorner& c : corners) out.corners.push_back({c.point, c.px, c.sigma_px});
  out.method = method;
  return out;
}

/// Single corners may leave much (glare, marks); most of a board's do not.
bool look_like_corners(const std::vector<ChessCorner>& corners) {
  const auto clear = std::count_if(corners.begin(), corners.end(),
                                   [](const ChessCorner& c) { return c.misfit < kMostMisfit; });
  return 2 * static_cast<std::size_t>(clear) > corners.size();
}

}  // namespace

Detection detect_chessboard(const cv::Mat& grey, const Chessboard& board) {
  Detection out;
  if (board.columns < 3 || board.rows < 3) {
    out.reason = fmt::format("a chessboard needs at least 3x3 inner corners to be found, this one has {}x{}",
                             board.columns, board.rows);
    return out;
  }
  const ChessSearch search = search_chessboard(grey, board);
  if (search.is_twice) {
    out.reason = fmt::format(
        "two {}x{} chessboards found, and nothing tells which is which: show one at a time, "
        "or use boards of different counts",
        board.columns, board.rows);
    return out;
  }
  if (search.grid.count() > 0) {
    std::vector<Vec2> px;
    for (const auto& p : search.grid.px) {
      if (p) px.push_back(*p);
    }
    const double noise = noise_level(grey, bounding_box(px, grey));
    const auto corners = refine_grid(grey, search.grid, search.scale, noise);
    ChessGrid fitted(board.columns, board.rows);
    for (const ChessCorner& c : corners) fitted.px[static_cast<std::size_t>(c.point)] = c.px;
    if (!has_kept_its_rims(search.grid, fitted)) {
      out.reason = fmt::format("{} of {} corners found, and nothing tells which", corners.size(),
                               board.columns * board.rows);
      return out;
    }
    if (goes_on(grey, fitted, corners, noise)) {
      out.reason = fmt::format("part of a larger board than {}x{}", board.columns, board.rows);
      return out;
    }
    if (5 * corners.size() >= 4 * px.size() && look_like_corners(corners))
      return found(corners, "saddle fit");
  }
  out.reason = fmt::format("no {}x{} chessboard found in {}x{} pixels", board.columns, board.rows, grey.cols,
                           grey.rows);
  if (!search.reason.empty()) out.reason += ": " + search.reason;
  return out;
}

}  // namespace plumbline::detail
