// SPDX-License-Identifier: Apache-2.0
#include "detect/saddles.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

namespace plumbline::detail {
namespace {

/// The image is smoothed by this and differenced over this many pixels: squares of 8 px keep their saddles.
constexpr double kSmooth = 1.0;
constexpr int kStep = 2;
/// Minus the determinant that a saddle needs: of eight grey levels of contrast, and so many times what noise
/// of deviation 1 makes of it.
constexpr float kLeast = 8, kPerNoise = 5;
constexpr int kBorder = kStep + 2;
constexpr int kRing = 16;
constexpr double kRingRadius = 3;

/// Minus the determinant of the second differences, one row.
void respond(const cv::Mat& smooth, int y, float* out) {
  const unsigned char *a = smooth.ptr(y - kStep), *b = smooth.ptr(y), *c = smooth.ptr(y + kStep);
  for (int x = kStep; x < smooth.cols - kStep; ++x) {
    const int middle = 2 * b[x];
    const auto xx = static_cast<float>(b[x - kStep] + b[x + kStep] - middle);
    const auto yy = static_cast<float>(a[x] + c[x] - middle);
    const auto xy = static_cast<float>(a[x - kStep] + c[x + kStep] - a[x + kStep] - c[x - kStep]);
    out[x] = 0.0625F * xy * xy - xx * yy;
  }
}

/// Whether the grey levels on a ring change sides four times, as around a corner of four fields.
bool has_four_fields(const cv::Mat& smooth, const cv::Point& p) {
  static const auto offsets = [] {
    std::array<cv::Point, kRing> out;
    for (int k = 0; k < kRing; ++k) {
      const double angle = 2 * std::numbers::pi * k / kRing;
      out[static_cast<std::size_t>(k)] = {static_cast<int>(std::lround(kRingRadius * std::cos(angle))),
                                          static_cast<int>(std::lround(kRingRadius * std::sin(angle)))};
    }
    return out;
  }();
  std::array<int, kRing> level{};
  int low = 255, high = 0;
  for (std::size_t k = 0; k < kRing; ++k) {
    level[k] = smooth.ptr(p.y + offsets[k].y)[p.x + offsets[k].x];
    low = std::min(low, level[k]);
    high = std::max(high, level[k]);
  }
  const int middle = (low + high) / 2;
  int changes = 0;
  for (std::size_t k = 0; k < kRing; ++k)
    changes += (level[k] > middle) != (level[(k + 1) % kRing] > middle) ? 1 : 0;
  return changes == 4;
}

/// The saddle near p to a fraction of a pixel; false where the grey levels have none within two pixels.
bool describe(const cv::Mat& smooth, const cv::Point& p, float response, Saddle& out) {
  const auto at = [&](int dx, int dy) { return static_cast<double>(smooth.ptr(p.y + dy)[p.x + dx]); };
  const double h = kStep;
  const double gx = (at(kStep, 0) - at(-kStep, 0)) / (2 * h), gy = (at(0, kStep) - at(0, -kStep)) / (2 * h);
  const double xx = (at(kStep, 0) + at(-kStep, 0) - 2 * at(0, 0)) / (h * h);
  const double yy = (at(0, kStep) + at(0, -kStep) - 2 * at(0, 0)) / (h * h);
  const double xy =
      (at(kStep, kStep) + at(-kStep, -kStep) - at(kStep, -kStep) - at(-kStep, kStep)) / (4 * h * h);
  const double det = xx * yy - xy * xy;
  if (!(det < 0)) return false;
  const Vec2 offset(-(yy * gx - xy * gy) / det, -(xx * gy - xy * gx) / det);
  if (!(offset.norm() < 2)) return false;
  out.px = Vec2(p.x, p.y) + offset;
  const double half = (xx - yy) / 2, root = std::hypot(half, xy), mean = (xx + yy) / 2;
  const double rising = mean + root, falling = mean - root;  // curvatures, > 0 and < 0
  const double turn = 0.5 * std::atan2(xy, half);            // of the rising direction
  out.bright = Vec2(std::cos(turn), std::sin(turn));
  // Along an edge the curvature vanishes.
  const double opening = std::atan(std::sqrt(-rising / falling));
  out.edge[0] = Vec2(std::cos(turn + opening), std::sin(turn + opening));
  out.edge[1] = Vec2(std::cos(turn - opening), std::sin(turn - opening));
  out.strength = std::sqrt(response);
  return opening > 0.15 && opening < std::numbers::pi / 2 - 0.15;
}

}  // namespace

std::vector<Saddle> find_saddles(const cv::Mat& grey, double noise, int most) {
  std::vector<Saddle> out;
  const int margin = std::max(kBorder, static_cast<int>(kRingRadius) + 1);
  if (grey.cols < 2 * margin + 1 || grey.rows < 2 * margin + 1) return out;
  cv::Mat smooth;
  cv::GaussianBlur(grey, smooth, cv::Size(5, 5), kSmooth);
  cv::Mat response(grey.rows, grey.cols, CV_32F);
  for (int y = kStep; y < grey.rows - kStep; ++y) respond(smooth, y, response.ptr<float>(y));
  const float least = std::max(kLeast, kPerNoise * static_cast<float>(noise * noise));
  struct Peak {
    float response;
    cv::Point at;
  };
  std::vector<Peak> peaks;
  for (int y = margin; y < grey.rows - margin; ++y) {
    const float* row = response.ptr<float>(y);
    for (int x = margin; x < grey.cols - margin; ++x) {
      const float r = row[x];
      if (r < least || r < row[x - 1] || r <= row[x + 1]) continue;
      bool is_peak = true;
      for (int dy = -2; dy <= 2 && is_peak; ++dy) {
        const float* other = response.ptr<float>(y + dy);
        for (int dx = -2; dx <= 2; ++dx) {
          if (other[x + dx] > r) is_peak = false;
        }
      }
      if (is_peak) peaks.push_back({r, {x, y}});
    }
  }
  std::sort(peaks.begin(), peaks.end(), [](const Peak& a, const Peak& b) {
    if (a.response != b.response) return a.response > b.response;
    return a.at.y != b.at.y ? a.at.y < b.at.y : a.at.x < b.at.x;
  });
  for (const Peak& peak : peaks) {
    if (static_cast<int>(out.size()) >= most) break;
    Saddle saddle;
    if (has_four_fields(smooth, peak.at) && describe(smooth, peak.at, peak.response, saddle))
      out.push_back(saddle);
  }
  return out;
}

}  // namespace plumbline::detail
