// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <map>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "detect/saddle_fit.hpp"
#include "detect/strays.hpp"

namespace plumbline::detail {

/// Tells a window how its edges bend [1/px], where that is more than a hundredth of a pixel within it, and
/// how far long arms may go along them.
void set_bends(const Vec2& bend, SaddleWindow& window);

/// Fits corners of straight board lines again where their neighbours on those lines say that the lens bends
/// the edges within the window by more than a hundredth of a pixel, and those that noise has left rough.
/// `windows`: those of the first fit, by point.
void refit_bent(const cv::Mat& grey, double noise, const std::map<int, SaddleWindow>& windows,
                std::vector<Refined>& corners);

}  // namespace plumbline::detail
