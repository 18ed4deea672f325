// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core/mat.hpp>
#include <optional>
#include <span>
#include <vector>

#include "detect/saddle_fit.hpp"
#include "plumbline/core/types.hpp"

namespace plumbline::detail {

/// A point to be refined: where it is about, and which pixels around it are its own.
struct CornerStart {
  Vec2 px;
  SaddleWindow window;
};

struct RefinedCorner {
  Vec2 px;
  double sigma_px = 0;
};

/// Standard deviation of the image's noise in grey levels, at least that of rounding to integers (0.29):
/// median of the absolute second differences (the mask of Immerkaer 1996) inside `roi`.
double noise_level(const cv::Mat& grey, cv::Rect roi);

/// The box around the points, grown by a tenth and cut to the image.
cv::Rect bounding_box(std::span<const Vec2> px, const cv::Mat& grey);

/// fit_saddle() of each start; nullopt where there is no corner.
std::vector<std::optional<RefinedCorner>> refine_corners(const cv::Mat& grey,
                                                         std::span<const CornerStart> starts, double noise);

/// Mean grey level of the two fields of a saddle at p that lie at +-(u + v), minus that of the fields at +-(u
/// - v); u, v reach from p into the fields [px]. Positive when the fields at +-(u + v) are brighter.
double saddle_contrast(const cv::Mat& grey, const Vec2& p, const Vec2& u, const Vec2& v);

/// Grey level by bilinear interpolation; p is moved into the image.
double sample(const cv::Mat& grey, const Vec2& p);

}  // namespace plumbline::detail
