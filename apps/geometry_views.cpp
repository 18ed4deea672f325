// SPDX-License-Identifier: Apache-2.0
#include "geometry_views.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include "plumbline/linear/fundamental.hpp"
#include "plumbline/refine/fundamental.hpp"

namespace plumbline::apps {
namespace {

double rms_sampson(const Mat3& F, const Matches& m) {
  double sum = 0;
  for (std::size_t i = 0; i < m.px1.size(); ++i) sum += std::pow(sampson_distance(F, m.px1[i], m.px2[i]), 2);
  return std::sqrt(sum / static_cast<double>(m.px1.size()));
}

}  // namespace

Result<EstimatedFundamental> estimate_fundamental(const Matches& matches, const RobustOptions& robust,
                                                  const RefinementOptions& refinement, const Common& common) {
  EstimatedFundamental out;
  out.inlier.assign(matches.px1.size(), true);
  const std::size_t n_rows = matches.px1.size();
  if (n_rows < (robust.ransac ? 8 : 7)) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("{} rows; a fundamental matrix needs at least {}", n_rows, robust.ransac ? 8 : 7), ""};
  }
  Matches kept = matches;
  if (robust.ransac) {
    auto found = fundamental_ransac(matches.px1, matches.px2, ransac_options(robust, common));
    if (!found) return found.error();
    out.F = found->model;
    out.inlier = found->consensus.inlier;
    kept = {chosen(matches.px1, out.inlier), chosen(matches.px2, out.inlier)};
  } else if (n_rows == 7) {
    auto found = fundamental_7point(matches.px1, matches.px2);
    if (!found) return found.error();
    if (found->empty())
      return Error{ErrorCode::kDegenerate, "no fundamental matrix of rank 2 goes through the seven rows", ""};
    out.solutions = *found;
    out.F = found->front();
    return out;
  } else {
    auto found = fundamental_8point(matches.px1, matches.px2);
    if (!found) return found.error();
    out.F = *found;
  }
  out.rms_px = rms_sampson(out.F, kept);
  if (refinement.linear) return out;
  auto refined = refine_fundamental(out.F, kept.px1, kept.px2, 1.0);
  if (!refined) return refined.error();
  const int n = static_cast<int>(kept.px1.size());
  out.F = refined->F;
  out.rms_px = rms_sampson(out.F, kept);
  out.sigma_px =
      refinement.sigma_px > 0 ? refinement.sigma_px : sigma_of_residuals(n * out.rms_px * out.rms_px, n, 7);
  if (out.sigma_px > 0) out.covariance = refined->covariance * out.sigma_px * out.sigma_px;
  return out;
}

SeenMatches seen_matches(const Matches& all, const Lens& lens_1, const Lens& lens_2) {
  SeenMatches out;
  for (std::size_t i = 0; i < all.px1.size(); ++i)
    out.seen.push_back(unproject(lens_1, all.px1[i]) && unproject(lens_2, all.px2[i]));
  out.matches = {chosen(all.px1, out.seen), chosen(all.px2, out.seen)};
  return out;
}

}  // namespace plumbline::apps
