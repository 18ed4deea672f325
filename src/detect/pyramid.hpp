// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core/mat.hpp>
#include <vector>

namespace plumbline::detail {

/// The image and its halves until no side is longer than `coarsest_px` (or one is too short to hold
/// anything), the smallest first. A level's pixel is the mean of four of the next, of which the last odd row
/// and column are left out: level k of n is smaller by 2^(n - 1 - k) exactly, and its pixel p has its centre
/// at (p + 0.5) times that, less 0.5.
std::vector<cv::Mat> pyramid_of(const cv::Mat& grey, int coarsest_px);

/// That factor.
double pyramid_ratio(std::size_t n_levels, std::size_t level);

}  // namespace plumbline::detail
