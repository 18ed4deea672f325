// SPDX-License-Identifier: Apache-2.0
#include "detect/pyramid.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace plumbline::detail {

std::vector<cv::Mat> pyramid_of(const cv::Mat& grey, int coarsest_px) {
  constexpr int kShortest = 32;  // px
  std::vector<cv::Mat> out{grey};
  while (std::max(out.front().cols, out.front().rows) > coarsest_px &&
         std::min(out.front().cols, out.front().rows) >= 2 * kShortest) {
    const cv::Mat& from = out.front();
    const cv::Size half_size(from.cols / 2, from.rows / 2);
    cv::Mat half;
    cv::resize(from(cv::Rect(0, 0, 2 * half_size.width, 2 * half_size.height)), half, half_size, 0, 0,
               cv::INTER_AREA);
    out.insert(out.begin(), half);
  }
  return out;
}

double pyramid_ratio(std::size_t n_levels, std::size_t level) {
  return std::exp2(static_cast<double>(n_levels - 1 - level));
}

}  // namespace plumbline::detail
