// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/two_view.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <utility>

#include "plumbline/linear/epipolar.hpp"
#include "plumbline/linear/essential.hpp"
#include "plumbline/linear/fundamental.hpp"
#include "plumbline/linear/triangulate.hpp"

namespace plumbline {
namespace {

void check(std::span<const Vec2> px1, std::span<const Vec2> px2) {
  PLUMBLINE_CHECK(px1.size() == px2.size(), "reconstruct needs as many pixels of each view");
}

std::optional<Error> refuse_few(std::size_t n, std::size_t needed) {
  if (n >= needed) return std::nullopt;
  return Error{ErrorCode::kDegenerate,
               fmt::format("{} pairs; the relation of the two views needs {}: add pairs", n, needed),
               "two views"};
}

// One point per pair by `locate`, which returns Result<Point>; pairs that are not `wanted` stay empty.
template <class Point, class Wanted, class Locate>
Result<std::vector<std::optional<Point>>> locate_all(std::size_t n, Wanted&& wanted, Locate&& locate) {
  std::vector<std::optional<Point>> points(n);
  std::optional<Error> first;
  std::size_t found = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (!wanted(i)) continue;
    const Result<Point> point = locate(i);
    if (point) {
      points[i] = *point;
      ++found;
    } else if (!first) {
      first = point.error();
      first->message = fmt::format("none of {} pairs gives a point; of pair {} (counted from 0): {}", n, i,
                                   first->message);
    }
  }
  if (found > 0) return points;
  if (!first) first = Error{ErrorCode::kDegenerate, "there are no pairs; add some", "two views"};
  first->code = ErrorCode::kDegenerate;
  return *first;
}

}  // namespace

std::string_view ambiguity(const TwoViewReconstruction& reconstruction) {
  constexpr std::array<std::string_view, 3> kNames{"up to a projective transform", "up to scale", "metric"};
  return kNames[reconstruction.index()];
}

MetricReconstruction with_baseline(const UpToScaleReconstruction& reconstruction, double baseline_m) {
  PLUMBLINE_CHECK(baseline_m > 0 && std::isfinite(baseline_m), "a baseline is a positive number of metres");
  MetricReconstruction metric;
  metric.T_2_1 = SE3(reconstruction.R_2_1, baseline_m * reconstruction.t_2_1_baselines);
  metric.p_1_m = reconstruction.p_1_baselines;
  for (auto& p : metric.p_1_m) {
    if (p) *p *= baseline_m;
  }
  return metric;
}

Result<MetricReconstruction> reconstruct(const KnownRig& known, std::span<const Vec2> px1,
                                         std::span<const Vec2> px2, const TwoViewOptions& options) {
  check(px1, px2);
  const std::array<PosedLens, 2> cameras{PosedLens{known.lens_1, SE3()},
                                         PosedLens{known.lens_2, known.T_2_1}};
  auto points = locate_all<Vec3>(
      px1.size(), [](std::size_t) { return true; },
      [&](std::size_t i) -> Result<Vec3> {
        const auto t = triangulate(cameras, std::array<Vec2, 2>{px1[i], px2[i]}, options.sigma_px);
        if (!t) return t.error();
        if (!(t->rms_px <= options.ransac.inlier_px)) {
          return Error{
              ErrorCode::kInvalidData,
              fmt::format("the rays miss one another by {:.3g} px (at most {} px are allowed); check the "
                          "correspondence and the rig",
                          t->rms_px, options.ransac.inlier_px),
              "two views"};
        }
        return t->p_world;
      });
  if (!points) return points.error();
  return MetricReconstruction{known.T_2_1, std::move(*points)};
}

Result<UpToScaleReconstruction> reconstruct(const KnownLenses& known, std::span<const Vec2> px1,
                                            std::span<const Vec2> px2, const TwoViewOptions& options) {
  check(px1, px2);
  if (const auto few = refuse_few(px1.size(), 6)) return *few;
  const auto found = essential_ransac(known.lens_1, known.lens_2, px1, px2, options.ransac);
  if (!found) return found.error();
  const SE3& T_2_1 = found->model.T_2_1;
  const std::array<PosedLens, 2> cameras{PosedLens{known.lens_1, SE3()}, PosedLens{known.lens_2, T_2_1}};
  auto points = locate_all<Vec3>(
      px1.size(), [&](std::size_t i) { return bool(found->consensus.inlier[i]); },
      [&](std::size_t i) -> Result<Vec3> {
        const auto t = triangulate(cameras, std::array<Vec2, 2>{px1[i], px2[i]}, options.sigma_px);
        if (!t) return t.error();
        return t->p_world;
      });
  if (!points) return points.error();
  return UpToScaleReconstruction{T_2_1.R(), T_2_1.t().normalized(), std::move(*points)};
}

Result<MetricReconstruction> reconstruct(const KnownLensesAndBaseline& known, std::span<const Vec2> px1,
                                         std::span<const Vec2> px2, const TwoViewOptions& options) {
  PLUMBLINE_CHECK(known.baseline_m > 0 && std::isfinite(known.baseline_m),
                  "a baseline is a positive number of metres");
  const auto up_to_scale = reconstruct(KnownLenses{known.lens_1, known.lens_2}, px1, px2, options);
  if (!up_to_scale) return up_to_scale.error();
  return with_baseline(*up_to_scale, known.baseline_m);
}

Result<ProjectiveReconstruction> reconstruct(const NothingKnown&, std::span<const Vec2> px1,
                                             std::span<const Vec2> px2, const TwoViewOptions& options) {
  check(px1, px2);
  if (const auto few = refuse_few(px1.size(), 8)) return *few;
  const auto found = fundamental_ransac(px1, px2, options.ransac);
  if (!found) return found.error();
  ProjectiveReconstruction result;
  std::tie(result.P1_px_X, result.P2_px_X) = canonical_cameras(found->model);
  auto points = locate_all<Vec4>(
      px1.size(), [&](std::size_t i) { return bool(found->consensus.inlier[i]); },
      [&](std::size_t i) { return triangulate_optimal(result.P1_px_X, result.P2_px_X, px1[i], px2[i]); });
  if (!points) return points.error();
  result.X = std::move(*points);
  return result;
}

Result<TwoViewReconstruction> reconstruct(const TwoViewKnowledge& known, std::span<const Vec2> px1,
                                          std::span<const Vec2> px2, const TwoViewOptions& options) {
  return std::visit(
      [&](const auto& k) -> Result<TwoViewReconstruction> {
        auto result = reconstruct(k, px1, px2, options);
        if (!result) return result.error();
        return TwoViewReconstruction(std::move(*result));
      },
      known);
}

}  // namespace plumbline
