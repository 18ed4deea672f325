// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "refine/solve.hpp"

/// Calibrations with clocks: the pose of a frame acts on the views of the frames around it too, so that board
/// poses cannot be eliminated one by one.
namespace plumbline::detail {

/// As solve_ceres(), with sparse normal equations. Views whose frame has no motion take no part.
SolveReport solve_moving(Calibration& calibration, const SolveSpec& spec);

/// The normal matrix of the shared parameters with all poses eliminated (banded Cholesky over the frames in
/// order of time), the sum of squared residuals, and their numbers.
struct MovingNormal {
  MatX S;
  double sum = 0;
  int n_residuals = 0, n_frames = 0;
};
MovingNormal moving_normal(const Calibration& calibration, const SolveSpec& spec);

}  // namespace plumbline::detail
