// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>

#include "refine/solve.hpp"

namespace ceres {
class CostFunction;
}

namespace plumbline::detail {

/// A one-sided constraint as residuals and their derivatives by the lens' parameters: 24 steps in each
/// direction, and for each the residual max(0, least - rise) * 100 / px, so that where the corners pull
/// against it with the force of a pixel it gives way by 1e-4 px. It samples the lens' formula beyond its
/// domain and knows nothing of polynomials. Not finite where the formula is not; no rows for a lens without a
/// closed form.
struct GuardRows {
  VecX r;  ///< before max(): negative where the lens rises enough, and there no part of the cost
  MatX J;  ///< one row for each residual
};
GuardRows guard_rows(const Lens& lens, const RadialGuard& guard);

/// With zeros in the rows where the lens rises enough.
GuardRows one_sided(GuardRows rows);

/// False for a lens without a closed form.
bool can_guard(const Lens& lens);

/// The same as a cost for Ceres; nullptr for a lens without a closed form.
std::unique_ptr<ceres::CostFunction> make_radial_guard(const Lens& lens, const RadialGuard& guard);

}  // namespace plumbline::detail
