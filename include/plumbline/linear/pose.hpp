// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"

namespace plumbline {

/// T_cam_board from a homography onto rays, H ~ [r1 r2 t]: the rotation nearest to [r1 r2 r1xr2], the
/// board in front along its rays. Zhang 2000, section 3.1.
/// \param H_ray_board  any positive scale; its SIGN says on which side of the camera the board is, so
///        it must have positive factors as homography_to_rays() gives them (K^-1 H with w > 0 for a
///        pinhole)
/// \returns kDegenerate for a singular H: a board seen edge-on
Result<SE3> pose_from_homography(const Mat3& H_ray_board);

/// Pose T_cam_board of a target seen by any lens: unprojects the pixels, then a homography (points in
/// one plane, or nearly, n >= 4) or a DLT (n >= 6 not coplanar), then Gauss-Newton steps on the
/// angular error of the rays. Points of one plane may lie anywhere in the target's frame. Pixels
/// outside the lens' domain are left out; outliers are not looked for.
/// \param p_board  n points [m]
/// \param px  n pixels; unequal numbers throw std::invalid_argument
/// \returns kDegenerate: too few points, all (or all but one of a plane) on a line, a board seen
///          edge-on. The message says how many pixels had a ray
Result<SE3> pose_from_points(const Lens& lens, std::span<const Vec3> p_board, std::span<const Vec2> px);

}  // namespace plumbline
