// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <vector>

#include "plumbline/refine/refine.hpp"
#include "refine/solve.hpp"

namespace plumbline::detail {

/// Fills covariance and stats.weak of an optimum, and refuses it when the data do not determine the lenses.
Status judge_determination(Calibration& calibration, const SolveSpec& spec);

}  // namespace plumbline::detail
