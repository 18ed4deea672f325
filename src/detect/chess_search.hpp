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
  int largest = 0;        ///< nodes of the largest lattice that was seen
};

/// The board, or a part of it that tells which, at the lowest of several sizes at which it is whole.
ChessSearch search_chessboard(const cv::Mat& grey, const Chessboard& board);

/// The corners of a grid refined, those that it lacks looked for where their neighbours say, and those thrown
/// out that are none. By point.
struct ChessCorner {
  int point = 0;
  Vec2 px;
  double sigma_px = 0;
  double contrast = 0;  ///< as SaddleFit's
  double misfit = 0;    ///< what the fit leaves, of the contrast
};
std::vector<ChessCorner> refine_grid(const cv::Mat& grey, const ChessGrid& grid, double scale, double noise);

}  // namespace plumbline::detail
