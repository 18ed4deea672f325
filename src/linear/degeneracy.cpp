// SPDX-License-Identifier: Apache-2.0
#include "linear/degeneracy.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "linear/consensus.hpp"
#include "linear/dlt.hpp"
#include "linear/null_space.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline::detail {

double variance_ratio_limit(double d1, double d2) {
  constexpr double z = 3.0902;  // of a normal variable, one of 1000 is larger
  const double a = 2 / (9 * d1), b = 2 / (9 * d2);
  const double bottom = (1 - b) * (1 - b) - z * z * b;
  if (!(bottom > 0)) return std::numeric_limits<double>::infinity();
  const double root =
      (1 - a) * (1 - b) + z * std::sqrt((1 - b) * (1 - b) * a + (1 - a) * (1 - a) * b - z * z * a * b);
  return std::pow(root / bottom, 3);
}

int needed_beyond_chance(int n, double p, double n_tried) {
  constexpr double kRisk = 1e-4;
  if (!(p > 0)) return 1;
  if (p >= 1) return n + 1;
  // Upward from the far end, where the tail is smallest.
  double tail = 0;
  for (int k = n; k >= 1; --k) {
    const double log_term = std::lgamma(n + 1.0) - std::lgamma(k + 1.0) - std::lgamma(n - k + 1.0) +
                            k * std::log(p) + (n - k) * std::log1p(-p);
    tail += std::exp(log_term);
    if (tail * n_tried > kRisk) return k + 1;
  }
  return 1;
}

double chance_of_agreement(double tolerance_px, std::span<const Vec2> px) {
  // sqrt(2) / scale is the RMS distance from the centroid, side / sqrt(6) for a full square.
  const double side = std::sqrt(6.0) * std::sqrt(2.0) / normaliser_of(px).scale;
  return std::min(1.0, 2 * std::sqrt(2.0) * tolerance_px / side);
}

Noise noise_of(const Mat3& F, std::span<const Lifted> a, std::span<const Lifted> b, int model_dof,
               double rounding_px) {
  constexpr double kPriorDof = 3, kPriorVariance = 1;  // [px^2]
  double sse = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sse += sampson_squared(F, a[i], b[i]);
  const double n = static_cast<double>(a.size()), dof = std::max(0.0, n - model_dof);
  if (std::sqrt(sse / n) <= rounding_px) return {rounding_px * rounding_px, dof + kPriorDof};
  return {(sse + kPriorDof * kPriorVariance) / (dof + kPriorDof), dof + kPriorDof};
}

double Noise::tolerance_px(std::size_t n) const {
  const double certain = 2 * std::log(1000.0), widened = variance_ratio_limit(2, dof) * 2;
  return std::sqrt(2 * std::log(1000.0 * static_cast<double>(n)) * std::max(1.0, widened / certain) *
                   variance);
}

std::optional<Mat3> four_point_homography(std::span<const Lifted> a, std::span<const Lifted> b,
                                          std::span<const int> sample) {
  Eigen::Matrix<double, 9, 8> A;  // rows of H one after the other
  for (int i = 0; i < 4; ++i) {
    const Lifted &p = a[static_cast<std::size_t>(sample[i])], &q = b[static_cast<std::size_t>(sample[i])];
    for (int r = 0; r < 2; ++r) {
      for (int j = 0; j < 3; ++j) A.block<3, 1>(3 * j, 2 * i + r) = q.J_px_v(r, j) * p.v;
    }
  }
  const auto null = null_space<9, 8>(A);
  if (!(null.determinacy > kRankTolerance)) return std::nullopt;
  Mat3 H = Eigen::Map<const Mat3>(null.basis.data()).transpose();
  const auto first = static_cast<std::size_t>(sample[0]);
  if (b[first].measure.dot(H * a[first].v) < 0) H = -H;
  return H;
}

std::optional<Mat3> fit_homography(std::span<const Lifted> a, std::span<const Lifted> b,
                                   std::span<const int> of) {
  if (of.size() < 4) return std::nullopt;
  MatX points(3, static_cast<Eigen::Index>(of.size()));
  std::vector<Mat23> E;
  for (std::size_t k = 0; k < of.size(); ++k) {
    const auto i = static_cast<std::size_t>(of[k]);
    points.col(static_cast<Eigen::Index>(k)) = a[i].v;
    E.push_back(b[i].J_px_v);
  }
  const DltSolution solution = solve_dlt(points, E);
  if (!(solution.determinacy > kRankTolerance)) return std::nullopt;
  Mat3 H = solution.H;
  double side = 0;
  for (const int i : of) {
    const auto k = static_cast<std::size_t>(i);
    side += b[k].measure.dot(H * a[k].v) > 0 ? 1 : -1;
  }
  return side < 0 ? Mat3(-H) : H;
}

std::optional<Found<Mat3>> dominant_homography(std::span<const Lifted> a, std::span<const Lifted> b,
                                               double tolerance_px, int most, std::uint64_t seed) {
  if (a.size() < 4) return std::nullopt;
  RansacOptions options;
  options.inlier_px = tolerance_px;
  options.confidence = 0.999;
  options.max_hypotheses = most;
  options.seed = seed;
  return find_consensus<Mat3>(
      static_cast<int>(a.size()), 4, options,
      [&](std::span<const int> sample, std::vector<Mat3>& out) {
        if (const auto H = four_point_homography(a, b, sample)) out.push_back(*H);
      },
      [&](const Mat3& H, int first, std::span<double> e2) {
        for (std::size_t k = 0; k < e2.size(); ++k) {
          const std::size_t i = static_cast<std::size_t>(first) + k;
          e2[k] = homography_sampson_squared(H, a[i], b[i]);
        }
      },
      [&](const Mat3&, std::span<const int> inliers) { return fit_homography(a, b, inliers); });
}

VarianceTest variance_test(const Mat3& F, const Mat3& H, std::span<const Lifted> a, std::span<const Lifted> b,
                           std::span<const int> on, double extra_dof, const Noise& noise) {
  // A fit by an algebraic distance, and a lens that bends lines a little, leave a homography more than its
  // share: a parallax that small carries no usable epipolar geometry either.
  constexpr double kLeastRatio = 2;
  double sse_F = 0, sse_H = 0;
  for (const int i : on) {
    const auto k = static_cast<std::size_t>(i);
    sse_F += sampson_squared(F, a[k], b[k]);
    sse_H += homography_sampson_squared(H, a[k], b[k]);
  }
  return {(sse_H - sse_F) / extra_dof / noise.variance,
          std::max(kLeastRatio, variance_ratio_limit(extra_dof, noise.dof))};
}

TwoViewComparison compare(const Mat3& F, std::span<const Lifted> a, std::span<const Lifted> b,
                          double rounding_px, const IsTurn& is_turn) {
  constexpr int kMostSamples = 64;  // a plane of 60 % is missed once in 7000
  const int n = static_cast<int>(a.size());
  const Noise noise = noise_of(F, a, b, 7, rounding_px);
  TwoViewComparison out;
  out.n = n;
  out.n_off_needed = 2;  // a homography and two pairs off it determine F
  out.noise_px = noise.sigma_px();
  const auto found = dominant_homography(a, b, noise.tolerance_px(a.size()), kMostSamples, 0);
  if (!found) {
    out.n_off = n;
    return out;
  }
  out.H = found->model;
  out.n_off = n - found->consensus.n_inliers;
  const std::vector<int> on = inlier_indices(found->consensus);
  if (out.n_off >= out.n_off_needed) return out;
  const VarianceTest test = variance_test(F, out.H, a, b, on, static_cast<double>(on.size()) - 1, noise);
  out.ratio = test.ratio, out.ratio_needed = test.needed;
  if (!test.is_degenerate()) return out;
  out.kind = is_turn(out.H, on) ? TwoViewDegeneracy::kPureRotation : TwoViewDegeneracy::kPlanarScene;
  return out;
}

}  // namespace plumbline::detail
