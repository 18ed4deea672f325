// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "plumbline/refine/refine.hpp"

/// Whether line delays and time offsets can be told from a data set: a recording, not stills.
namespace plumbline::detail {

/// kDegenerate when views have no time, or when no frames follow one another closely enough for a motion;
/// with the numbers and what to record. Needs no poses.
Status check_recording(const Calibration& calibration);

/// kUnsupported for what solve_moving() does not know: ties, priors, and lenses with sparse derivatives.
Status check_moving(const Calibration& calibration, const RefineOptions& options);

/// Takes out the views whose frame has no motion, with a reason.
void drop_motionless(Calibration& calibration);

/// kDegenerate when the boards did not move smoothly from frame to frame: the root mean square distance of
/// the board's first and last point from where the two frames before and the two after put them (cubic) is
/// above kRoughest of the distance that they move from one frame to the next. For a sinusoid that bound means
/// that velocities err by 3 %. Noise counts too: a board that hardly moves is refused.
Status check_smoothness(const Calibration& calibration);
inline constexpr double kRoughest = 0.15;

}  // namespace plumbline::detail
