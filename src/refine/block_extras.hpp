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

}  // namespace plumbline::detail
