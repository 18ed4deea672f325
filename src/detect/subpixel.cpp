// SPDX-License-Identifier: Apache-2.0
#include "detect/subpixel.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>

namespace plumbline::detail {
namespace {

/// The image is smoothed before cornerSubPix, whose differences of a sharp edge alias: with a window of +-8
/// px the mean error on rendered boards falls from 0.03 to 0.02 px. Not more than this, or the window's
/// neighbours leak in.
constexpr double kBlurOfWindow = 0.125, kMaxBlur = 1.0;

/// What noise does not explain (aliasing, the edges' bend inside the window) and what the error formula
/// leaves out (the smoothing, the correlation of neighbouring differences), for a window of +-1 px; both fall
/// with the root of the window. Set on rendered boards, where the errors are known: docs/detect.md has the
/// table.
constexpr double kSystematic = 0.045, kNoiseGain = 2.05;

/// Standard error of the point q that solves sum w g g' (q - p) = 0 over a window (cv::cornerSubPix, after
/// Foerstner and Guelch 1987). With noise of deviation s in every pixel, the gradient g by central
/// differences has noise s / sqrt 2 in each part; along an edge g0' (q - p) vanishes, so what is left is w g0
/// dg' (q - p), and cov = M^-1 (sum w^2 g0 g0' |q - p|^2 s^2 / 2) M^-1 with M = sum w g0 g0'.
std::optional<double> standard_error(const cv::Mat& grey, const Vec2& q, int half, double noise) {
  Mat2 M = Mat2::Zero(), N = Mat2::Zero();
  for (int dy = -half; dy <= half; ++dy) {
    for (int dx = -half; dx <= half; ++dx) {
      const Vec2 p(q.x() + dx, q.y() + dy);
      const Vec2 g((sample(grey, p + Vec2(1, 0)) - sample(grey, p - Vec2(1, 0))) / 2,
                   (sample(grey, p + Vec2(0, 1)) - sample(grey, p - Vec2(0, 1))) / 2);
      const double x = static_cast<double>(dx) / half, y = static_cast<double>(dy) / half;
      const double w = std::exp(-x * x - y * y);
      M += w * g * g.transpose();
      N += w * w * (dx * dx + dy * dy) * g * g.transpose();
    }
  }
  const double det = M.determinant();
  if (!(det > 1e-4 * M.trace() * M.trace())) return std::nullopt;  // one direction of edges only: no corner
  Mat2 inverse;
  inverse << M(1, 1), -M(0, 1), -M(1, 0), M(0, 0);
  inverse /= det;
  const Mat2 cov = inverse * N * inverse * (noise * noise / 2);
  return std::sqrt((kNoiseGain * kNoiseGain * cov.trace() / 2 + kSystematic * kSystematic) / half);
}

bool fits(const cv::Mat& grey, const Vec2& p, int half) {
  const double margin = half + 1;
  return p.x() >= margin && p.y() >= margin && p.x() <= grey.cols - 1 - margin &&
         p.y() <= grey.rows - 1 - margin;
}

}  // namespace

int half_window(double reach_px) {
  return std::clamp(static_cast<int>(std::floor(reach_px)), kMinHalfWindow, kMaxHalfWindow);
}

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
  // Every image row is too much for a large photograph; some 200,000 pixels say it as well.
  const int step = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(roi.area()) / 2e5)));
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
  std::vector<std::optional<RefinedCorner>> out(starts.size());
  std::map<int, std::vector<std::size_t>> by_window;
  for (std::size_t i = 0; i < starts.size(); ++i) {
    if (fits(grey, starts[i].px, starts[i].half_window_px)) by_window[starts[i].half_window_px].push_back(i);
  }
  const cv::TermCriteria stop(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 40, 1e-3);
  for (const auto& [half, members] : by_window) {
    std::vector<cv::Point2f> points;
    for (std::size_t i : members)
      points.emplace_back(static_cast<float>(starts[i].px.x()), static_cast<float>(starts[i].px.y()));
    const double blur = std::min(kBlurOfWindow * half, kMaxBlur);
    cv::Mat smooth;
    cv::GaussianBlur(grey, smooth, cv::Size(), blur);
    cv::cornerSubPix(smooth, points, cv::Size(half, half), cv::Size(-1, -1), stop);
    for (std::size_t k = 0; k < members.size(); ++k) {
      const CornerStart& start = starts[members[k]];
      const Vec2 q(points[k].x, points[k].y);
      // cornerSubPix puts a corner that left its window back to where it started: it has not moved at all
      // then, but a start that is exact to the last bit does not occur with photographs or matters as little.
      if (!q.allFinite() || (q - start.px).norm() > start.max_move_px || !fits(grey, q, half)) continue;
      if (const auto sigma = standard_error(grey, q, half, noise)) out[members[k]] = RefinedCorner{q, *sigma};
    }
  }
  return out;
}

double saddle_contrast(const cv::Mat& grey, const Vec2& p, const Vec2& u, const Vec2& v) {
  return (sample(grey, p + u + v) + sample(grey, p - u - v) - sample(grey, p + u - v) -
          sample(grey, p - u + v)) /
         2;
}

}  // namespace plumbline::detail
