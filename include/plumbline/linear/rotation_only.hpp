// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

namespace plumbline {

/// px2 ~ H px1 of a camera that only turns (or of points at infinity): H = K2 R_2_1 K1^-1 (Hartley &
/// Zisserman 2004, section 8.4).
Mat3 rotation_homography(const Mat3& K1, const Mat3& K2, const Mat3& R_2_1);

/// A rotation and how well it explains what it was made from.
struct RotationOnly {
  Mat3 R_2_1;
  double residual;  ///< each function says of what
};

/// R = K2^-1 H K1 for H of any scale and sign: the matrix of determinant +1, then the nearest rotation. The
/// residual is the largest deviation of that matrix' singular values from 1: 0 for a rotation, about |t| / d
/// for a camera that moved by t before a plane at distance d. \param tolerance  largest residual that counts
/// as a rotation; noise of the pixels makes about their sigma
///        over the focal length, times the square root of what the fit amplifies it by
/// \returns kInvalidData with the residual when H is not that of a rotation ("translation": plane_motions()
/// reads
///          it) or holds NaN; kDegenerate for a singular H
Result<RotationOnly> rotation_from_homography(const Mat3& H, const Mat3& K1, const Mat3& K2,
                                              double tolerance = 0.01);

/// The rotation that takes unit rays of camera 1 to those of camera 2 best, for cameras with any lens:
/// minimises  sum |ray_2 - R ray_1|^2  (Wahba 1965, by the singular value decomposition of Kabsch 1976). The
/// residual is the root mean square angle between R ray_1 and ray_2 [rad]; a translation shows in it.
/// \param rays_1, rays_2  n >= 2 directions; fewer, or unequal numbers, throw std::invalid_argument
/// \returns kDegenerate when the rays of one camera are all parallel; kInvalidData for NaN
Result<RotationOnly> rotation_from_rays(std::span<const Vec3> rays_1, std::span<const Vec3> rays_2);

}  // namespace plumbline
