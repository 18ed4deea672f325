// SPDX-License-Identifier: Apache-2.0
#include "detect/saddle_fit.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "detect/saddle_kernel.hpp"
#include "detect/saddle_window.hpp"
#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

/// Of the first rounds, which only have to find the corner: arms, and a blur that grows with the square,
/// since large squares are found in reduced images and their corners lie farther from where they are looked
/// for.
constexpr double kFirstArmPx = 7, kFirstArmBlurs = 5;
constexpr double kMinBlur = 0.25, kMaxBlur = 8, kFirstBlur = 1.2, kFirstBlurOfSquare = 0.03,
                 kMostFirstBlur = 4;
constexpr double kMinContrast = 3;     ///< grey levels
constexpr double kLeastError = 0.003;  ///< px; what the model itself is worth (a pixel is no Gaussian)
constexpr double kNearPx = 0.05, kTherePx = 5e-3;  ///< last steps of the first rounds and of the others
constexpr int kMinPixels = 14;
/// The answer of longer arms has to be the same within so many standard
/// errors and leave about as little.
constexpr double kSameSigmas = 3, kSameMisfit = 1.1;
/// Windows of fewer pixels do not tell blur from contrast: they are told that the blur is about a pixel and
/// that the light is even, with the weight of residuals of a seventh of the contrast.
constexpr int kFewPixels = 80;
constexpr double kLeastErrorOfFew = 0.008;  // px; what those expectations and the edges beside are worth
constexpr double kUsualBlur = 0.9, kBlurWeight = 0.25, kSlopeWeight = 60;

constexpr int kN = kSaddleParams;
using Params = std::array<double, kN>;

/// The pixels of a fit, and room for the kernel's columns.
struct Region {
  WindowPixels pixels;
  std::vector<float> columns;
};

void collect(const cv::Mat& grey, const Vec2& q, const SaddleWindow& window, double arm_px, double blur,
             Region& out) {
  collect_window(grey, q, window, arm_px, blur, out.pixels);
  out.columns.resize(static_cast<std::size_t>(kSaddleColumns) *
                     static_cast<std::size_t>(out.pixels.n_padded));
}

struct Normal {
  std::array<double, kN * kN> A{};  ///< lower triangle
  Params b{};
  double cost = 0;
};

void add_expectations(const Params& p, Normal& out) {
  const double weight = kBlurWeight * p[6] * p[6], off = kUsualBlur - p[4];
  out.A[4 * kN + 4] += weight;
  out.b[4] += weight * off;
  out.cost += weight * off * off;
  for (std::size_t k = 7; k < 9; ++k) {
    out.A[k * kN + k] += kSlopeWeight;
    out.b[k] -= kSlopeWeight * p[k];
    out.cost += kSlopeWeight * p[k] * p[k];
  }
}

void accumulate(Region& region, const Params& p, const Vec2& curvature, Normal& out) {
  const auto f = [](double v) { return static_cast<float>(v); };
  const SaddleModel model{.x = f(p[0] - region.pixels.origin.x()),
                          .y = f(p[1] - region.pixels.origin.y()),
                          .cos1 = f(std::cos(p[2])),
                          .sin1 = f(std::sin(p[2])),
                          .cos2 = f(std::cos(p[3])),
                          .sin2 = f(std::sin(p[3])),
                          .inverse_blur = f(1 / p[4]),
                          .mean = f(p[5]),
                          .step = f(p[6]),
                          .slope_x = f(p[7]),
                          .slope_y = f(p[8]),
                          .bend1 = f(curvature.x() / 2),
                          .bend2 = f(curvature.y() / 2)};
  std::array<float, kSaddleColumns*(kSaddleColumns + 1) / 2> lower;
  best_saddle_kernels().sum(region.pixels.view(), model, region.columns.data(), lower.data());
  const float* at = lower.data();
  for (int i = 0; i < kN; ++i) {
    for (int j = 0; j <= i; ++j) out.A[static_cast<std::size_t>(i * kN + j)] = *at++;
  }
  for (double& b : out.b) b = *at++;
  out.cost = *at;
  if (region.pixels.n < kFewPixels) add_expectations(p, out);
}

/// Cholesky factor in place, false when the matrix is not positive definite.
bool factor(std::array<double, kN * kN>& A) {
  for (int j = 0; j < kN; ++j) {
    for (int i = j; i < kN; ++i) {
      double sum = A[i * kN + j];
      for (int k = 0; k < j; ++k) sum -= A[i * kN + k] * A[j * kN + k];
      if (i == j) {
        if (!(sum > 1e-12)) return false;
        A[j * kN + j] = std::sqrt(sum);
      } else {
        A[i * kN + j] = sum / A[j * kN + j];
      }
    }
  }
  return true;
}

Params solve(const std::array<double, kN * kN>& L, Params b) {
  for (int i = 0; i < kN; ++i) {
    for (int k = 0; k < i; ++k) b[i] -= L[i * kN + k] * b[k];
    b[i] /= L[i * kN + i];
  }
  for (int i = kN - 1; i >= 0; --i) {
    for (int k = i + 1; k < kN; ++k) b[i] -= L[k * kN + i] * b[k];
    b[i] /= L[i * kN + i];
  }
  return b;
}

/// Levenberg-Marquardt over the pixels of `region` until steps are shorter than `enough_px`; false when it
/// does not settle.
bool settle(Region& region, const Vec2& curvature, int rounds, double enough_px, Params& p, Normal& normal) {
  double damping = 1e-3;
  accumulate(region, p, curvature, normal);
  for (int round = 0; round < rounds; ++round) {
    auto A = normal.A;
    for (int i = 0; i < kN; ++i) A[i * kN + i] *= 1 + damping;
    if (!factor(A)) return false;
    const Params step = solve(A, normal.b);
    Params next = p;
    for (int i = 0; i < kN; ++i) next[i] += step[i];
    // The blur is a scale: halved or doubled at most.
    next[4] = std::clamp(next[4], std::max(kMinBlur, p[4] / 2), std::min(kMaxBlur, p[4] * 2));
    Normal trial;
    accumulate(region, next, curvature, trial);
    const bool is_short = std::hypot(step[0], step[1]) < enough_px;
    // Sums in single precision: costs that differ by less are the same.
    if (!(trial.cost <= normal.cost * (is_short ? 1 + 1e-5 : 1))) {
      damping *= 10;
      if (damping > 1e4) return true;  // no step gets lower: this is the bottom
      continue;
    }
    const bool is_done = is_short && trial.cost > normal.cost * (1 - 1e-4);
    p = next;
    normal = trial;
    damping = std::max(damping / 10, 1e-9);
    if (is_done) return true;
  }
  return true;
}

double turned(double angle, double from) { return std::abs(std::remainder(angle - from, std::numbers::pi)); }

/// The standard error of the corner: the inverse of the normal equations, times what the residuals are.
std::optional<double> standard_error(const Normal& normal, double variance) {
  auto L = normal.A;
  if (!factor(L)) return std::nullopt;
  double trace = 0;
  for (int k = 0; k < 2; ++k) {
    Params unit{};
    unit[static_cast<std::size_t>(k)] = 1;
    trace += solve(L, unit)[static_cast<std::size_t>(k)];
  }
  return std::sqrt(variance * trace / 2);
}

/// A first state of the model, from the pixels next to `start`; false where there is nothing.
bool find(const cv::Mat& grey, const Vec2& start, const SaddleWindow& window, const double (&angle)[2],
          Region& region, Params& p) {
  const Vec2 u = window.J.col(0), v = window.J.col(1);
  const double square = std::abs(window.J.determinant()) / std::max(u.norm(), v.norm());
  const double blur = std::clamp(kFirstBlurOfSquare * square, kFirstBlur, kMostFirstBlur);
  collect(grey, start, window, std::min(window.max_arm_px, std::max(kFirstArmPx, kFirstArmBlurs * blur)),
          blur, region);
  if (region.pixels.n < kMinPixels) return false;
  double mean = 0;
  for (int i = 0; i < region.pixels.n; ++i)
    mean += static_cast<double>(region.pixels.grey[static_cast<std::size_t>(i)]) / region.pixels.n;
  const double reach = std::min({0.5 * window.across, 2 * blur / u.norm(), 2 * blur / v.norm()});
  const double step = saddle_contrast(grey, start, u * reach, v * reach) / 2;
  p = {start.x(), start.y(), angle[0], angle[1], blur, mean, step, 0, 0};
  Normal normal;
  return settle(region, window.curvature, 8, kNearPx, p, normal);
}

/// What a settled state says of the corner.
std::optional<SaddleFit> judged(const Region& region, const Params& p, const Normal& normal, double noise) {
  SaddleFit fit;
  fit.state = p;
  fit.px = Vec2(p[0], p[1]);
  fit.contrast = p[6];
  fit.blur_px = p[4];
  fit.misfit = std::sqrt(normal.cost / std::max(1, region.pixels.n - kN));
  const auto sigma = standard_error(normal, std::max(fit.misfit * fit.misfit, noise * noise));
  if (!sigma || !fit.px.allFinite()) return std::nullopt;
  fit.sigma_px = std::hypot(*sigma, region.pixels.n < kFewPixels ? kLeastErrorOfFew : kLeastError);
  return fit;
}

/// Whether the model describes the pixels, with edges that run as those of the window (at `angle`).
bool is_corner(const SaddleFit& fit, const Params& p, const double (&angle)[2], const SaddleWindow& window,
               double noise) {
  return std::abs(fit.contrast) >= kMinContrast &&
         fit.misfit <= window.max_misfit * std::abs(fit.contrast) + noise && turned(p[2], p[3]) >= 0.15 &&
         turned(p[2], angle[0]) <= 0.5 && turned(p[3], angle[1]) <= 0.5;
}

}  // namespace

std::optional<SaddleFit> fit_saddle(const cv::Mat& grey, const Vec2& start, const SaddleWindow& window,
                                    double noise, const SaddleFit* before) {
  const Vec2 u = window.J.col(0), v = window.J.col(1);
  const double angle[2] = {std::atan2(u.y(), u.x()), std::atan2(v.y(), v.x())};
  Region region;
  Params p{};
  Normal normal;
  if (before) {
    p = before->state;
  } else if (!find(grey, start, window, angle, region, p)) {
    return std::nullopt;
  }
  const double limit = window.max_move_px;
  for (int round = 0; round < 2; ++round) {
    const Vec2 at(p[0], p[1]);
    if (!at.allFinite() || (at - start).norm() > limit) return std::nullopt;
    collect(grey, at, window, window.max_arm_px, p[4], region);
    if (region.pixels.n < kMinPixels || 2 * region.pixels.n < region.pixels.places) return std::nullopt;
    if (!settle(region, window.curvature, 12, kTherePx, p, normal)) return std::nullopt;
    if ((Vec2(p[0], p[1]) - at).norm() < 0.3) break;
  }
  auto fit = judged(region, p, normal, noise);
  if (!fit || (fit->px - start).norm() > limit || !is_corner(*fit, p, angle, window, noise))
    return std::nullopt;
  if (window.long_arm_px <= window.max_arm_px || fit->sigma_px < kRoughSigmaPx) return fit;
  // Much noise: as much of the edges as there is.
  collect(grey, fit->px, window, window.long_arm_px, p[4], region);
  if (!settle(region, window.curvature, 12, kTherePx, p, normal)) return fit;
  const auto longer = judged(region, p, normal, noise);
  const bool is_same = longer && (longer->px - fit->px).norm() < kSameSigmas * fit->sigma_px &&
                       longer->misfit < kSameMisfit * fit->misfit && longer->sigma_px < fit->sigma_px &&
                       is_corner(*longer, p, angle, window, noise);
  return is_same ? longer : fit;
}

}  // namespace plumbline::detail
