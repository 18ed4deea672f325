// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/linear/triangulate.hpp"

namespace plumbline {

/// The point that minimises the reprojection error  sum |lens_i(T_i p) - px_i|^2  over its views by
/// Levenberg-Marquardt, any lenses, cameras held fixed: the maximum-likelihood point under equal,
/// independent, normal noise of the pixel coordinates (Hartley & Zisserman 2004, section 12.3), with its
/// covariance to first order (J'J)^-1 sigma_px^2.
/// \param start_world  near the answer, as triangulate() gives it
/// \param cameras, px  n >= 2 views; unequal numbers throw std::invalid_argument
/// \param sigma_px  standard deviation of each pixel coordinate, > 0 [px]
/// \returns the refusals of triangulate() at the answer (parallel rays, a point behind a camera);
///          kInvalidData when a lens does not see `start_world`; kNotConverged after 100 steps
Result<Triangulated> refine_point(const Vec3& start_world, std::span<const PosedLens> cameras,
                                  std::span<const Vec2> px, double sigma_px);

}  // namespace plumbline
