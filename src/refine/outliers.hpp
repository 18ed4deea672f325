// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "plumbline/refine/refine.hpp"

namespace plumbline::detail {

/// Marks the corners of each camera whose residual is longer than options.outlier_sigma robust standard
/// deviations of a coordinate (1.4826 times the median of the absolute coordinates over all corners of the
/// camera, marked ones too, so that a corner can come back; at least 0.01 px, below which no corner finder
/// goes). A view that keeps fewer than four corners, or fewer than a quarter, is dropped with a reason.
/// Corners outside the lens' domain are marked as well. \returns whether anything changed
bool mark_outliers(Calibration& calibration, const RefineOptions& options);

/// Takes a view out, and its frame's pose when no other view of the frame is left.
void drop_view(Calibration& calibration, std::size_t view, std::string reason);

}  // namespace plumbline::detail
