// SPDX-License-Identifier: Apache-2.0
#include "detect/saddle_fit.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

constexpr double kShare = 0.5;  ///< of the way to the next corner, which has the rest
/// Of the first rounds, which only have to find the corner: arms, and a blur that grows with the square,
/// since large squares are found in reduced images and their corners lie farther from where they are looked
/// for.
constexpr double kFirstArmPx = 7, kFirstArmBlurs = 5;
constexpr double kEdgeReach = 3.5;  ///< an edge is flat beyond so many blurs
constexpr double kLeak = 1.5;       ///< the next edge is felt up to so many blurs before it
constexpr double kMinBlur = 0.25, kMaxBlur = 8, kFirstBlur = 1.2, kFirstBlurOfSquare = 0.03,
                 kMostFirstBlur = 4;
constexpr double kMinContrast = 3;     ///< grey levels
constexpr double kLeastError = 0.003;  ///< px; what the model itself is worth (a pixel is no Gaussian)
constexpr int kMinPixels = 14;
/// Windows of fewer pixels do not tell blur from contrast: they are told that the blur is about a pixel and
/// that the light is even, with the weight of residuals of a seventh of the contrast.
constexpr std::size_t kFewPixels = 80;
constexpr double kUsualBlur = 0.9, kBlurWeight = 0.25, kSlopeWeight = 60;

/// Parameters: corner x, y; directions of the edges; blur; mean, half step, slopes of the light along x and
/// y.
constexpr int kN = 9;
using Params = std::array<double, kN>;

/// erf(z / sqrt 2) and its derivative, from a table: the inner loop asks for it twice a pixel.
class EdgeTable {
 public:
  static constexpr double kEnd = 4.5, kPerUnit = 128;
  EdgeTable() {
    for (std::size_t i = 0; i < kSize; ++i) {
      const double z = static_cast<double>(i) / kPerUnit - kEnd;
      value_[i] = std::erf(z / std::numbers::sqrt2);
    }
  }
  /// Value at z, and slope of the line between the two entries around it.
  double at(double z, double& slope) const {
    if (z <= -kEnd || z >= kEnd - 1 / kPerUnit) {
      slope = 0;
      return z < 0 ? -1 : 1;
    }
    const double x = (z + kEnd) * kPerUnit;
    const auto i = static_cast<std::size_t>(x);
    slope = (value_[i + 1] - value_[i]) * kPerUnit;
    return value_[i] + (x - static_cast<double>(i)) * (value_[i + 1] - value_[i]);
  }

 private:
  static constexpr std::size_t kSize = static_cast<std::size_t>(2 * kEnd * kPerUnit) + 2;
  std::array<double, kSize> value_{};
};

const EdgeTable& edge_table() {
  static const EdgeTable table;
  return table;
}

struct Pixel {
  float x, y, grey;
};

/// Pixels of the window around `q`, and how many of its places lie in the image.
struct Region {
  std::vector<Pixel> pixels;
  int places = 0;
};

void collect(const cv::Mat& grey, const Vec2& q, const SaddleWindow& w, double arm_px, double blur,
             Region& out) {
  out.pixels.clear();
  out.places = 0;
  const Mat2 board_from_px = w.J.inverse();
  const double length[2] = {w.J.col(0).norm(), w.J.col(1).norm()};
  // Heights: the distance between neighbouring lines of the lattice.
  const double height = std::abs(w.J.determinant());
  const double across_px[2] = {height / length[0], height / length[1]};  // of one unit beside edge 0, edge 1
  double low[2], high[2], side[2];
  for (int k = 0; k < 2; ++k) {
    // What bounds the arm along axis k is the next line across it, at a distance measured across it.
    const double leak = kLeak * blur / across_px[1 - k];
    low[k] = -std::min({-w.low[k] - leak, kShare, arm_px / length[k]});
    high[k] = std::min({w.high[k] - leak, kShare, arm_px / length[k]});
    side[k] =
        std::min({w.across - kLeak * blur / across_px[k], kShare, (kEdgeReach * blur + 0.5) / across_px[k]});
    // At the least a pixel to each side, or nothing is left to fit.
    side[k] = std::max(side[k], std::min(w.across, 1.2 / across_px[k]));
    low[k] = std::min(low[k], -1.5 / length[k]);
    high[k] = std::max(high[k], 1.5 / length[k]);
  }
  Vec2 reach = Vec2::Zero();
  for (int k = 0; k < 2; ++k) {
    const double a = std::max(-low[k], high[k]), b = side[k];
    reach = reach.cwiseMax((w.J.col(k) * a).cwiseAbs() + (w.J.col(1 - k) * b).cwiseAbs());
  }
  const int x0 = static_cast<int>(std::ceil(q.x() - reach.x())), x1 = static_cast<int>(q.x() + reach.x());
  const int y0 = static_cast<int>(std::ceil(q.y() - reach.y())), y1 = static_cast<int>(q.y() + reach.y());
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      const Vec2 p = board_from_px * (Vec2(x, y) - q);
      const bool on_edge0 = p.x() >= low[0] && p.x() <= high[0] && std::abs(p.y()) <= side[0];
      const bool on_edge1 = p.y() >= low[1] && p.y() <= high[1] && std::abs(p.x()) <= side[1];
      if (!on_edge0 && !on_edge1) continue;
      ++out.places;
      if (x < 0 || y < 0 || x >= grey.cols || y >= grey.rows) continue;
      out.pixels.push_back(
          {static_cast<float>(x), static_cast<float>(y), static_cast<float>(grey.ptr<unsigned char>(y)[x])});
    }
  }
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

void accumulate(const std::vector<Pixel>& pixels, const Params& p, const Vec2& curvature, Normal& out) {
  const EdgeTable& edge = edge_table();
  const double c1 = std::cos(p[2]), s1 = std::sin(p[2]), c2 = std::cos(p[3]), s2 = std::sin(p[3]);
  const double inverse_blur = 1 / p[4];
  out = {};
  for (const Pixel& pixel : pixels) {
    const double dx = pixel.x - p[0], dy = pixel.y - p[1];
    const double along1 = c1 * dx + s1 * dy, along2 = c2 * dx + s2 * dy;
    const double beside1 = -s1 * dx + c1 * dy - 0.5 * curvature.x() * along1 * along1;
    const double beside2 = -s2 * dx + c2 * dy - 0.5 * curvature.y() * along2 * along2;
    double slope1 = 0, slope2 = 0;
    const double z1 = beside1 * inverse_blur, z2 = beside2 * inverse_blur;
    const double e1 = edge.at(z1, slope1), e2 = edge.at(z2, slope2);
    // The field where both board offsets have one sign lies on different sides of the two edges.
    const double shape = -e1 * e2;
    const double d1 = -p[6] * slope1 * e2 * inverse_blur, d2 = -p[6] * e1 * slope2 * inverse_blur;
    const double g[kN] = {d1 * s1 + d2 * s2,
                          -d1 * c1 - d2 * c2,
                          -d1 * along1,
                          -d2 * along2,
                          -d1 * z1 - d2 * z2,
                          1,
                          shape,
                          dx,
                          dy};
    const double r = pixel.grey - (p[5] + p[6] * shape + p[7] * dx + p[8] * dy);
    out.cost += r * r;
    for (int i = 0; i < kN; ++i) {
      out.b[static_cast<std::size_t>(i)] += g[i] * r;
      for (int j = 0; j <= i; ++j) out.A[static_cast<std::size_t>(i * kN + j)] += g[i] * g[j];
    }
  }
  if (pixels.size() < kFewPixels) add_expectations(p, out);
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

/// Levenberg-Marquardt over the pixels of `region`; false when it does not settle.
bool settle(const Region& region, const Vec2& curvature, int rounds, Params& p, Normal& normal) {
  double damping = 1e-3;
  accumulate(region.pixels, p, curvature, normal);
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
    accumulate(region.pixels, next, curvature, trial);
    if (!(trial.cost <= normal.cost)) {
      damping *= 10;
      if (damping > 1e4) return true;  // no step gets lower: this is the bottom
      continue;
    }
    const bool is_done = std::hypot(step[0], step[1]) < 1e-3 && trial.cost > normal.cost * (1 - 1e-4);
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

}  // namespace

std::optional<SaddleFit> fit_saddle(const cv::Mat& grey, const Vec2& start, const SaddleWindow& window,
                                    double noise) {
  const Vec2 u = window.J.col(0), v = window.J.col(1);
  const double angle[2] = {std::atan2(u.y(), u.x()), std::atan2(v.y(), v.x())};
  Region region;
  const double square = std::abs(window.J.determinant()) / std::max(u.norm(), v.norm());
  const double blur = std::clamp(kFirstBlurOfSquare * square, kFirstBlur, kMostFirstBlur);
  collect(grey, start, window, std::min(window.max_arm_px, std::max(kFirstArmPx, kFirstArmBlurs * blur)),
          blur, region);
  if (static_cast<int>(region.pixels.size()) < kMinPixels) return std::nullopt;
  double mean = 0;
  for (const Pixel& pixel : region.pixels) mean += pixel.grey / static_cast<double>(region.pixels.size());
  const double reach = std::min({0.5 * window.across, 2 * blur / u.norm(), 2 * blur / v.norm()});
  const double step = saddle_contrast(grey, start, u * reach, v * reach) / 2;
  Params p{start.x(), start.y(), angle[0], angle[1], blur, mean, step, 0, 0};
  Normal normal;
  if (!settle(region, window.curvature, 8, p, normal)) return std::nullopt;
  const double limit = window.max_move_px;
  for (int round = 0; round < 2; ++round) {
    const Vec2 at(p[0], p[1]);
    if (!at.allFinite() || (at - start).norm() > limit) return std::nullopt;
    collect(grey, at, window, window.max_arm_px, p[4], region);
    if (static_cast<int>(region.pixels.size()) < kMinPixels ||
        2 * static_cast<int>(region.pixels.size()) < region.places)
      return std::nullopt;
    if (!settle(region, window.curvature, 12, p, normal)) return std::nullopt;
    if ((Vec2(p[0], p[1]) - at).norm() < 0.3) break;
  }
  SaddleFit fit;
  fit.px = Vec2(p[0], p[1]);
  fit.contrast = p[6];
  fit.blur_px = p[4];
  const double n = static_cast<double>(region.pixels.size());
  fit.misfit = std::sqrt(normal.cost / std::max(1.0, n - kN));
  const double skew = turned(p[2], p[3]);
  if (!fit.px.allFinite() || (fit.px - start).norm() > limit || std::abs(fit.contrast) < kMinContrast ||
      fit.misfit > window.max_misfit * std::abs(fit.contrast) + noise || skew < 0.15 ||
      turned(p[2], angle[0]) > 0.5 || turned(p[3], angle[1]) > 0.5)
    return std::nullopt;
  const auto sigma = standard_error(normal, std::max(fit.misfit * fit.misfit, noise * noise));
  if (!sigma) return std::nullopt;
  fit.sigma_px = std::hypot(*sigma, kLeastError);
  return fit;
}

}  // namespace plumbline::detail
