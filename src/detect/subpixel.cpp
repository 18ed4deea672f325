// SPDX-License-Identifier: Apache-2.0
#include "detect/subpixel.hpp"

#include <algorithm>
#include <cmath>

namespace plumbline::detail {

double sample(const cv::Mat& grey, const Vec2& p) {
  const double x = std::clamp(p.x(), 0.0, grey.cols - 1.0), y = std::clamp(p.y(), 0.0, grey.rows - 1.0);
  const int x0 = std::min(static_cast<int>(x), std::max(grey.cols - 2, 0));
  const int y0 = std::min(static_cast<int>(y), std::max(grey.rows - 2, 0));
  const int x1 = std::min(x0 + 1, grey.cols - 1), y1 = std::min(y0 + 1, grey.rows - 1);
  const double fx = x - x0, fy = y - y0;
  const auto* a = grey.ptr<unsigned char>(y0);
  const auto* b = grey.ptr<unsigned char>(y1);
  return (1 - fy) * ((1 - fx) * a[x0] + fx * a[x1]) + fy * ((1 - fx) * b[x0] + fx * b[x1]);
}

cv::Rect bounding_box(std::span<const Vec2> px, const cv::Mat& grey) {
  if (px.empty()) return {0, 0, grey.cols, grey.rows};
  Vec2 low = px[0], high = px[0];
  for (const Vec2& p : px) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Vec2 margin = (high - low) / 10 + Vec2(4, 4);
  low -= margin;
  high += margin;
  const cv::Rect box(static_cast<int>(low.x()), static_cast<int>(low.y()),
                     static_cast<int>(high.x() - low.x()), static_cast<int>(high.y() - low.y()));
  return box & cv::Rect(0, 0, grey.cols, grey.rows);
}

double noise_level(const cv::Mat& grey, cv::Rect roi) {
  roi &= cv::Rect(1, 1, grey.cols - 2, grey.rows - 2);
  std::array<int, 256 * 16> histogram{};
  long n = 0;
  // Every image row is too much for a large photograph; some 30,000 pixels say it as well.
  const int step = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(roi.area()) / 3e4)));
  for (int y = roi.y; y < roi.y + roi.height; y += step) {
    const unsigned char *a = grey.ptr(y - 1), *b = grey.ptr(y), *c = grey.ptr(y + 1);
    for (int x = roi.x; x < roi.x + roi.width; x += step) {
      const int v =
          a[x - 1] + a[x + 1] + c[x - 1] + c[x + 1] + 4 * b[x] - 2 * (a[x] + c[x] + b[x - 1] + b[x + 1]);
      ++histogram[static_cast<std::size_t>(std::abs(v))];
      ++n;
    }
  }
  long below = 0;
  int median = 0;
  while (median < static_cast<int>(histogram.size()) - 1 && 2 * (below + histogram[median]) < n)
    below += histogram[median++];
  // Within the median's bin by linear interpolation; the mask's gain is 6, the median of |N(0,1)| is 0.6745.
  const double inside = n > 0 && histogram[median] > 0
                            ? (0.5 * static_cast<double>(n) - static_cast<double>(below)) / histogram[median]
                            : 0;
  return std::max(0.29, (std::max(0.0, median - 0.5) + inside) / (6 * 0.6745));
}

std::vector<std::optional<RefinedCorner>> refine_corners(const cv::Mat& grey,
                                                         std::span<const CornerStart> starts, double noise) {
  std::vector<std::optional<RefinedCorner>> out;
  out.reserve(starts.size());
  for (const CornerStart& start : starts) {
    auto fit = fit_saddle(grey, start.px, start.window, noise);
    if (!fit) {
      // Glare, or a strong bend: closer to the corner there is less of it.
      SaddleWindow shorter = start.window;
      shorter.max_arm_px = kShortArmPx;
      fit = fit_saddle(grey, start.px, shorter, noise);
    }
    out.push_back(fit ? std::optional(RefinedCorner{fit->px, fit->sigma_px}) : std::nullopt);
  }
  return out;
}

double saddle_contrast(const cv::Mat& grey, const Vec2& p, const Vec2& u, const Vec2& v) {
  return (sample(grey, p + u + v) + sample(grey, p - u - v) - sample(grey, p + u - v) -
          sample(grey, p - u + v)) /
         2;
}

}  // namespace plumbline::detail
