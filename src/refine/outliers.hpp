// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "plumbline/refine/refine.hpp"

namespace plumbline::detail {

/// Marks the corners of each camera whose residual is longer than options.outlier_sigma robust standard
/// deviations of a coordinate (1.4826 times the median of the absolute coordinates over all corners of the
/// camera, marked ones too, so that a corner can come back; at least 0.01 px, below which no corner finder
/// goes). The length of a good corner's residual exceeds k standard deviations with probability exp(-k^2 /
/// 2): 3.7e-6 for k = 5. A view that keeps fewer than four corners, or fewer than a quarter, and that is
/// alone in its frame gets the pose that most of its corners agree on (pose_ransac), where at least half do;
/// else it is dropped with a reason. Corners outside the lens' domain are marked as well. \returns whether
/// anything changed
bool mark_outliers(Calibration& calibration, const RefineOptions& options);

/// Marks what is four times as far off, and drops no view: before the first solve of all, whose start is not
/// yet so good that a corner could be condemned.
void mark_gross(Calibration& calibration, const RefineOptions& options);

/// What leaving out residuals longer than k standard deviations takes off the variance that is left, as a
/// factor: 1 - (k^2 / 2) / (exp(k^2 / 2) - 1), for two Gaussian coordinates. 0.95 at k = 3, 1 - 5e-5 at k
/// = 5.
double truncated_variance(double k);

/// Takes a view out, and its frame's pose when no other view of the frame is left.
void drop_view(Calibration& calibration, std::size_t view, std::string reason);

}  // namespace plumbline::detail
