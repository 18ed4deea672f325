// SPDX-License-Identifier: Apache-2.0
// What a robust search must still be asked: whether its inliers are more than chance gives, and whether they
// determine more than a homography.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "linear/consensus.hpp"
#include "linear/degeneracy.hpp"

namespace plumbline::detail {
namespace {

double largest_distance_px(const Mat3& F, std::span<const Lifted> a, std::span<const Lifted> b,
                           std::span<const int> of) {
  double largest = 0;
  for (const int i : of) {
    const auto k = static_cast<std::size_t>(i);
    largest = std::max(largest, sampson_squared(F, a[k], b[k]));
  }
  return std::sqrt(largest);
}

}  // namespace

std::vector<Lifted> subset(std::span<const Lifted> all, std::span<const int> of) {
  std::vector<Lifted> out;
  out.reserve(of.size());
  for (const int i : of) out.push_back(all[static_cast<std::size_t>(i)]);
  return out;
}

Noise noise_among(const Found<Mat3>& found, std::span<const Lifted> a, std::span<const Lifted> b,
                  int model_dof, double rounding_px) {
  const std::vector<int> inliers = inlier_indices(found.consensus);
  return noise_of(found.model, subset(a, inliers), subset(b, inliers), model_dof, rounding_px);
}

Plane split_by_homography(const Mat3& H, std::span<const Lifted> a, std::span<const Lifted> b,
                          double tolerance_px) {
  Plane plane{H, {}, {}};
  for (std::size_t i = 0; i < a.size(); ++i) {
    const bool on = homography_sampson_squared(H, a[i], b[i]) <= tolerance_px * tolerance_px;
    (on ? plane.on : plane.off).push_back(static_cast<int>(i));
  }
  return plane;
}

std::optional<Plane> dominant_plane(const Found<Mat3>& found, std::span<const Lifted> a,
                                    std::span<const Lifted> b, const Noise& noise, std::uint64_t seed) {
  // A plane of 70 % is missed once in 6000; smaller ones leave RANSAC enough samples with points off them.
  constexpr int kMostSamples = 32;
  const std::vector<int> inliers = inlier_indices(found.consensus);
  const double tolerance = noise.tolerance_px(inliers.size());
  const auto H = dominant_homography(subset(a, inliers), subset(b, inliers), tolerance, kMostSamples, seed);
  if (!H || 2 * H->consensus.n_inliers < static_cast<int>(inliers.size())) return std::nullopt;
  return split_by_homography(H->model, a, b, tolerance);
}

TwoViewComparison judge(const Found<Mat3>& found, const Plane& plane, std::span<const Lifted> a,
                        std::span<const Lifted> b, std::span<const Vec2> px2, const Noise& noise,
                        double extra_dof) {
  const auto is_inlier = [&](int i) { return found.consensus.inlier[static_cast<std::size_t>(i)]; };
  std::vector<int> on, off;
  std::copy_if(plane.on.begin(), plane.on.end(), std::back_inserter(on), is_inlier);
  std::copy_if(plane.off.begin(), plane.off.end(), std::back_inserter(off), is_inlier);
  const int others = static_cast<int>(plane.off.size());
  const double p = chance_of_agreement(largest_distance_px(found.model, a, b, off), px2);
  TwoViewComparison out;
  out.n = found.consensus.n_inliers;
  out.n_off = static_cast<int>(off.size());
  // Two pairs off the plane fix the rest; the best two of all are what a search finds.
  out.n_off_needed = 2 + needed_beyond_chance(std::max(0, others - 2), p, 0.5 * others * (others - 1.0));
  out.noise_px = noise.sigma_px();
  out.H = plane.H;
  if (out.n_off >= out.n_off_needed || on.size() < 4) return out;
  const VarianceTest test =
      variance_test(found.model, plane.H, a, b, on, static_cast<double>(on.size()) + extra_dof, noise);
  out.ratio = test.ratio, out.ratio_needed = test.needed;
  if (test.is_degenerate()) out.kind = TwoViewDegeneracy::kPlanarScene;
  return out;
}

std::optional<Error> refuse_chance(const Found<Mat3>& found, std::span<const Lifted> a,
                                   std::span<const Lifted> b, std::span<const Vec2> px2, int model_dof,
                                   double n_tried, const char* what, const char* where) {
  const int n = static_cast<int>(a.size());
  const std::vector<int> inliers = inlier_indices(found.consensus);
  const double p = chance_of_agreement(largest_distance_px(found.model, a, b, inliers), px2);
  const int needed = model_dof + needed_beyond_chance(n - model_dof, p, n_tried);
  if (found.consensus.n_inliers >= needed) return std::nullopt;
  return Error{ErrorCode::kDegenerate,
               fmt::format("no {} has more inliers than chance gives: {} of {} pairs, at least {} are needed "
                           "after {} samples; use more pairs, or better ones",
                           what, found.consensus.n_inliers, n, needed, found.consensus.n_hypotheses),
               where};
}

}  // namespace plumbline::detail
