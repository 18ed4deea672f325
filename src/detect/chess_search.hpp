// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core/mat.hpp>
#include <string>

#include "detect/chess_grid.hpp"

namespace plumbline::detail {

/// What the search for saddles and lattices made of an image.
struct ChessSearch {
  ChessGrid grid;         ///< numbered, in pixels of the image; nothing known: not found
  double scale = 1;       ///< of the image that it was found in: places are good to a pixel of that
  std::string reason;     ///< why not
  bool is_twice = false;  ///< two whole boards, and nothing tells which
};

/// The board, or a part of it that tells which, at the lowest of several sizes at which it is whole.
ChessSearch search_chessboard(const cv::Mat& grey, const Chessboard& board);

/// Whether the corners of a board that a grid lacks lie outside of the image, or nearer than `border_px` to
/// its border, as far as those beside them say.
bool is_all_in_sight(const ChessGrid& grid, cv::Size image, double border_px);

}  // namespace plumbline::detail
