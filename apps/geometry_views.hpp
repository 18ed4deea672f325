// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <vector>

#include "geometry_args.hpp"

namespace plumbline::apps {

/// F of matched pixels: the closed form or RANSAC, refined unless --linear.
struct EstimatedFundamental {
  Mat3 F;
  std::vector<bool> inlier;  ///< one per match
  double rms_px = 0;         ///< of the inliers' distances
  double sigma_px = 0;       ///< what the covariance is for; 0: not known
  std::optional<MatX> covariance;
  std::vector<Mat3> solutions;  ///< of exactly seven matches: one or three
};
Result<EstimatedFundamental> estimate_fundamental(const Matches& matches, const RobustOptions& robust,
                                                  const RefinementOptions& refinement, const Common& common);

/// The matches that both lenses have a ray for.
struct SeenMatches {
  Matches matches;
  std::vector<bool> seen;  ///< one per row of the file
};
SeenMatches seen_matches(const Matches& all, const Lens& lens_1, const Lens& lens_2);

}  // namespace plumbline::apps
