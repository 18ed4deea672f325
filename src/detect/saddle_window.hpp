// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core/mat.hpp>
#include <vector>

#include "detect/saddle_fit.hpp"
#include "detect/saddle_kernel.hpp"

namespace plumbline::detail {

/// The pixels that belong to a corner, in columns for the kernel.
struct WindowPixels {
  Vec2 origin = Vec2::Zero();             ///< the pixel that x and y count from
  std::vector<float> x, y, grey, weight;  ///< as long as has been needed: the first n_padded count
  int n = 0;                              ///< without the padding
  int n_padded = 0;
  int places = 0;  ///< of the window, those outside of the image too
  SaddlePixels view() const { return {x.data(), y.data(), grey.data(), weight.data(), n_padded}; }
};

/// The pixels around a corner at `q` that lie near one of its two edges: as far along them as `arm_px`, half
/// the way to the next corner and the window allow, and so far beside them that a `blur` of that size is flat
/// there.
void collect_window(const cv::Mat& grey, const Vec2& q, const SaddleWindow& window, double arm_px,
                    double blur, WindowPixels& out);

}  // namespace plumbline::detail
