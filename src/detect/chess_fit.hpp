// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core/mat.hpp>
#include <vector>

#include "detect/chess_grid.hpp"
#include "detect/saddle_fit.hpp"

namespace plumbline::detail {

struct ChessCorner {
  int point = 0;
  Vec2 px;
  double sigma_px = 0;
  double contrast = 0;  ///< as SaddleFit's
  double misfit = 0;    ///< what the fit leaves, of the contrast
};
/// What a board has beside its edges.
struct GridFit {
  double across = 1;           ///< how far it is clean beside an edge [squares]
  double least_across_px = 0;  ///< corners where that is less are left out
  double least_blurs = 0;      ///< so too where it is less than this many times the usual blur
  int rounds = 3;              ///< of looking for corners that are missing
};
/// The corners of a grid refined, those that it lacks looked for where their neighbours say, and those thrown
/// out that are none; ascending by point. `scale`: of the image in which the grid was found.
std::vector<ChessCorner> refine_grid(const cv::Mat& grey, const ChessGrid& grid, double scale, double noise,
                                     const GridFit& how = {});

}  // namespace plumbline::detail
