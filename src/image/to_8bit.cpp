// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <vector>

#include "plumbline/image/image.hpp"

namespace plumbline {
namespace {

/// One in so many numbers at each end of the range does not count.
constexpr std::size_t kOneIn = 10000;

struct Range {
  double low = 0, high = 0;
};

Range range_of_16_bit(const cv::Mat& image) {
  std::vector<std::size_t> count(65536, 0);
  const int width = image.cols * image.channels();
  for (int r = 0; r < image.rows; ++r) {
    const auto* row = image.ptr<std::uint16_t>(r);
    for (int c = 0; c < width; ++c) ++count[row[c]];
  }
  const std::size_t left_out = image.total() * static_cast<std::size_t>(image.channels()) / kOneIn;
  Range range{0, 65535};
  for (std::size_t n = count[0]; n <= left_out; n += count[static_cast<std::size_t>(range.low)]) ++range.low;
  for (std::size_t n = count[65535]; n <= left_out; n += count[static_cast<std::size_t>(range.high)])
    --range.high;
  return range;
}

Range range_of_floats(const cv::Mat& image) {
  std::vector<float> values;
  values.reserve(image.total() * static_cast<std::size_t>(image.channels()));
  const int width = image.cols * image.channels();
  for (int r = 0; r < image.rows; ++r) {
    const auto* row = image.ptr<float>(r);
    std::copy_if(row, row + width, std::back_inserter(values), [](float v) { return std::isfinite(v); });
  }
  if (values.empty()) return {};
  const auto left_out = static_cast<std::ptrdiff_t>(values.size() / kOneIn);
  const auto quantile = [&](std::ptrdiff_t at) {
    std::nth_element(values.begin(), values.begin() + at, values.end());
    return static_cast<double>(values[static_cast<std::size_t>(at)]);
  };
  const double low = quantile(left_out);
  return {low, quantile(static_cast<std::ptrdiff_t>(values.size()) - 1 - left_out)};
}

}  // namespace

cv::Mat to_8bit(const cv::Mat& image) {
  if (image.depth() == CV_8U || image.empty()) return image;
  cv::Mat numbers = image, out;
  const bool is_16_bit = image.depth() == CV_16U;
  if (!is_16_bit) {
    image.convertTo(numbers, CV_32F);
    cv::patchNaNs(numbers, 0);
  }
  const Range range = is_16_bit ? range_of_16_bit(numbers) : range_of_floats(numbers);
  // Whole numbers are never spread over more levels than they have; of floats nobody knows the step.
  const double width = range.high - range.low;
  const bool is_whole = image.depth() != CV_32F && image.depth() != CV_64F;
  const double scale = width > 0 ? 255 / (is_whole ? std::max(width, 255.0) : width) : 1;
  // With 255 levels or fewer that 8 bits can hold as they are, they are left as they are.
  const double offset = scale == 1 && range.high <= 255 && range.low >= 0 ? 0 : -scale * range.low;
  numbers.convertTo(out, CV_8U, scale, offset);
  return out;
}

}  // namespace plumbline
