// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

namespace plumbline {

/// Homography by normalised DLT (Hartley & Zisserman 2004, alg. 4.2):  w [b; 1] = H [a; 1],
/// |H| = 1, w > 0 for the first point.
/// \param a, b  n >= 4 points of each plane, any unit; fewer, or unequal numbers, throw
///        std::invalid_argument
/// \returns kDegenerate when the null space has more than one dimension: all points, or all but one,
///          on a line in either plane (also with noise), or fewer than four places;
///          kInvalidData for NaN
Result<Mat3> homography(std::span<const Vec2> a, std::span<const Vec2> b);

/// The same onto rays instead of pixels:  ray ~ H [a; 1] with a POSITIVE factor (for most points,
/// should the points contradict one another), |H| = 1, for lenses that see behind themselves.
/// Minimises  sum |ray x H a|^2, in which every ray weighs the same.
/// \param rays_cam  unit directions in the camera frame, any z
/// \returns as homography(); kDegenerate also for a board seen edge-on (all rays in one plane)
Result<Mat3> homography_to_rays(std::span<const Vec2> a, std::span<const Vec3> rays_cam);

}  // namespace plumbline
