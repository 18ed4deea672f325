// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "detect/saddles.hpp"

namespace plumbline::detail {

/// Four saddles (indices) around a dark field, clockwise as seen.
using DarkQuad = std::array<int, 4>;

/// The dark fields of an image that saddles bound: each is the next along the edge of the one before, and
/// along every side but one at most it is dark within and bright without. What is inside of them is not
/// looked at: a tag is one, and a small square between tags is another. `most_px`: longest side.
std::vector<DarkQuad> find_dark_quads(const cv::Mat& grey, const std::vector<Saddle>& saddles,
                                      double most_px);

}  // namespace plumbline::detail
