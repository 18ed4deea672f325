// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "refine/block_normal.hpp"

/// What the block solver's cost has besides corners: priors and radial guards. Both are residuals of the
/// shared parameters alone.
namespace plumbline::detail {

/// Adds them to the cost and to A_ss and g_s. A guard of a camera that no view of the problem shows is left
/// out.
void add_extras(const BlockProblem& problem, const BlockState& state, BlockNormal& normal);

/// Adds their J' r, with derivatives at `state` and residuals at `other`, to the shared part of a gradient.
void add_mixed_extras(const BlockProblem& problem, const BlockState& state, const BlockState& other,
                      VecX& gradient);

/// How far to go along a step, and what that promises of the cost.
struct StepLength {
  double length = 1, gain = 0;
};
/// The equations know the guards in force at `state`, and a full step against others would end far up their
/// slope. This is the minimum along the step over [0, 1] of the quadratic model with all guards, each to
/// first order. \param slope      g'd of the step \param curvature  d'Ad
StepLength guarded_length(const BlockProblem& problem, const BlockState& state, const BlockVector& step,
                          double slope, double curvature);

}  // namespace plumbline::detail
