// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <ceres/cost_function.h>

#include <memory>

#include "refine/solve.hpp"

namespace plumbline::detail {

/// A one-sided constraint as a cost of the lens' parameters: 24 steps in each direction, and for each the
/// residual max(0, least - rise) * 100 / px, so that where the corners pull against it with the force of a
/// pixel it gives way by 1e-4 px. It samples the lens' formula beyond its domain and knows nothing of
/// polynomials. nullptr for a lens without a closed form.
std::unique_ptr<ceres::CostFunction> make_radial_guard(const Lens& lens, const RadialGuard& guard);

}  // namespace plumbline::detail
