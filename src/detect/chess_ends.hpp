// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "detect/chess_fit.hpp"
#include "detect/chess_grid.hpp"

/// What tells a board from another one that contains it: a plain board has no ids, only ends.
namespace plumbline::detail {

/// Whether the outermost rows and columns of `before` are still there after the corners' fit. Where one is
/// not, it was clutter, and what the board's ends said about its numbering is void.
bool has_kept_its_rims(const ChessGrid& before, const ChessGrid& after);

/// Whether the board goes on where it should end: beside most corners of one of its sides, one step further,
/// there is another corner with the colours and the contrast of the board's. `grid` holds the corners.
bool goes_on(const cv::Mat& grey, const ChessGrid& grid, const std::vector<ChessCorner>& corners,
             double noise);

/// Whether steps change slowly from one to the next. Those of tags with gaps between them, whose corners are
/// saddles in rows too, do not.
bool has_even_steps(const ChessGrid& grid);

}  // namespace plumbline::detail
