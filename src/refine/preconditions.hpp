// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>

#include "plumbline/refine/refine.hpp"
#include "refine/constraints.hpp"

/// What must hold before a solve makes sense, and after it for its numbers to mean something.
namespace plumbline::detail {

/// kInvalidData: a number among the options that is none.
Status check_options(const RefineOptions& options);

/// Says why of each view with too few corners for a pose, or without one, and lets it take no part.
void refuse_small_views(Calibration& calibration);

/// The first corner that takes part and does not project at the start.
std::optional<Error> unprojectable(const Calibration& calibration);

/// Enough views to constrain each lens: of a flat board three (Zhang 2000), fewer where some of fx fy cx cy
/// are known; of points in space one. kDegenerate names the camera.
Status enough_views(const Calibration& calibration, const Constraints& constraints);

/// What a start got wrong, or the marking of outliers, can leave cameras without views, or without a frame
/// that joins them to the others: then their numbers mean nothing.
Status still_together(const Calibration& calibration, const Constraints& constraints);

/// Where a camera stands and its focal length are not known before a solve from corners alone, so holding
/// them needs a start or values: what the seed has of them is one guess of many. (Its centre in the middle,
/// and terms of distortion that are zero, are what holding those without a value means.) kInvalidData names
/// the option. \param empty  the calibration before its seed
Status check_held_without_start(const Calibration& empty, const Constraints& constraints,
                                const RefineOptions& options);

/// Ceres knows no ties in a rig with a splined lens, and some such rigs only Ceres can solve: kUnsupported
/// says why.
Status check_ties_beside_spline(const Calibration& calibration, const SolveSpec& spec);

}  // namespace plumbline::detail
