// SPDX-License-Identifier: Apache-2.0
#include "detect/saddles.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "detect/saddle_kernel.hpp"

namespace plumbline::detail {
namespace {

/// The image is smoothed by this and differenced over this many pixels: squares of 8 px keep their saddles.
constexpr double kSmooth = 1.0;
constexpr int kStep = kSaddleStep;
/// Minus the determinant that a saddle needs: of eight grey levels of contrast, and so many times what noise
/// of deviation 1 makes of it.
constexpr float kLeast = 8, kPerNoise = 5;
constexpr int kBorder = kStep + 2;
constexpr int kRing = 16;
constexpr double kRingRadius = 3;

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

/// Differences of the grey levels around a pixel.
struct Differences {
  double gx, gy, xx, yy, xy;
  /// To where the gradient vanishes.
  Vec2 offset() const { return Vec2(xy * gy - yy * gx, xy * gx - xx * gy) / (xx * yy - xy * xy); }
};

Differences differences(const cv::Mat& smooth, const cv::Point& p) {
  constexpr double h = kStep;
  const unsigned char *above = smooth.ptr(p.y - kStep) + p.x, *here = smooth.ptr(p.y) + p.x,
                      *below = smooth.ptr(p.y + kStep) + p.x;
  return {.gx = (here[kStep] - here[-kStep]) / (2 * h),
          .gy = (below[0] - above[0]) / (2 * h),
          .xx = (here[kStep] + here[-kStep] - 2 * here[0]) / (h * h),
          .yy = (below[0] + above[0] - 2 * here[0]) / (h * h),
          .xy = (below[kStep] + above[-kStep] - above[kStep] - below[-kStep]) / (4 * h * h)};
}

/// Whether the gradient vanishes within two pixels: beside an edge noise makes saddles that lean.
bool is_level(const cv::Mat& smooth, const cv::Point& p) {
  return differences(smooth, p).offset().squaredNorm() < 4;
}

/// The saddle near p to a fraction of a pixel; false where its edges are nearly one. \pre is_level
bool describe(const cv::Mat& smooth, const cv::Point& p, float response, Saddle& out) {
  const Differences d = differences(smooth, p);
  out.px = Vec2(p.x, p.y) + d.offset();
  const double half = (d.xx - d.yy) / 2, root = std::hypot(half, d.xy), mean = (d.xx + d.yy) / 2;
  const double rising = mean + root, falling = mean - root;  // curvatures, > 0 and < 0
  const double turn = 0.5 * std::atan2(d.xy, half);          // of the rising direction
  out.bright = Vec2(std::cos(turn), std::sin(turn));
  // Along an edge the curvature vanishes.
  const double opening = std::atan(std::sqrt(-rising / falling));
  out.edge[0] = Vec2(std::cos(turn + opening), std::sin(turn + opening));
  out.edge[1] = Vec2(std::cos(turn - opening), std::sin(turn - opening));
  out.strength = std::sqrt(response);
  return opening > 0.15 && opening < std::numbers::pi / 2 - 0.15;
}

struct Peak {
  float response;
  cv::Point at;
};

/// The last rows of the response: more would only travel to memory and back.
class Rows {
 public:
  explicit Rows(int columns) : rows_(kN, columns, CV_32F, cv::Scalar(0)) {}
  float* at(int y) { return rows_.ptr<float>(y % kN); }
  /// Whether nothing within two pixels is larger.
  bool is_highest(int x, int y) {
    const float r = at(y)[x];
    // Ridges run across rows: those next to this one mostly decide.
    for (const int dy : {1, -1, 2, -2, 0}) {
      const float* row = at(y + dy) + x;
      if (std::max({row[-2], row[-1], row[0], row[1], row[2]}) > r) return false;
    }
    return true;
  }

 private:
  static constexpr int kN = 8;
  cv::Mat rows_;
};

/// Local maxima of the response of `least` or more, at `margin` from the border at least.
std::vector<Peak> peaks_of(const cv::Mat& smooth, float least, int margin) {
  const SaddleKernels& kernels = best_saddle_kernels();
  Rows response(smooth.cols);
  const auto respond = [&](int y) {
    if (y >= kStep && y < smooth.rows - kStep)
      kernels.respond(smooth.ptr(y - kStep), smooth.ptr(y), smooth.ptr(y + kStep), smooth.cols,
                      response.at(y));
  };
  for (int y = margin - 2; y < margin + 2; ++y) respond(y);
  std::vector<Peak> out;
  std::vector<int> columns(static_cast<std::size_t>(smooth.cols));
  for (int y = margin; y < smooth.rows - margin; ++y) {
    respond(y + 2);
    const float* row = response.at(y);
    const int n = kernels.peaks(row, margin, smooth.cols - margin, least, columns.data());
    for (int i = 0; i < n; ++i) {
      const int x = columns[static_cast<std::size_t>(i)];
      if (response.is_highest(x, y) && is_level(smooth, {x, y})) out.push_back({row[x], {x, y}});
    }
  }
  return out;
}

bool is_stronger(const Peak& a, const Peak& b) {
  if (a.response != b.response) return a.response > b.response;
  return a.at.y != b.at.y ? a.at.y < b.at.y : a.at.x < b.at.x;
}

}  // namespace

std::vector<Saddle> find_saddles(const cv::Mat& grey, double noise, int most) {
  std::vector<Saddle> out;
  const int margin = std::max(kBorder, static_cast<int>(kRingRadius) + 1);
  if (grey.cols < 2 * margin + 1 || grey.rows < 2 * margin + 1) return out;
  cv::Mat smooth;
  cv::GaussianBlur(grey, smooth, cv::Size(5, 5), kSmooth);
  std::vector<Peak> peaks =
      peaks_of(smooth, std::max(kLeast, kPerNoise * static_cast<float>(noise * noise)), margin);
  // Sorted as far as they are asked for.
  const auto chunk = static_cast<std::ptrdiff_t>(2 * static_cast<std::size_t>(most));
  for (auto from = peaks.begin(); from != peaks.end() && static_cast<int>(out.size()) < most;) {
    const auto to = peaks.end() - from > chunk ? from + chunk : peaks.end();
    if (to != peaks.end()) std::nth_element(from, to, peaks.end(), is_stronger);
    std::sort(from, to, is_stronger);
    for (; from != to && static_cast<int>(out.size()) < most; ++from) {
      Saddle saddle;
      if (has_four_fields(smooth, from->at) && describe(smooth, from->at, from->response, saddle))
        out.push_back(saddle);
    }
  }
  return out;
}

}  // namespace plumbline::detail
