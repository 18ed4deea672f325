// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"

namespace plumbline {

/// T_cam_board from a homography onto rays, H ~ [r1 r2 t]: the rotation nearest to [r1 r2 r1xr2], the board
/// in front along its rays. Zhang 2000, section 3.1.
Result<SE3> pose_from_homography(const Mat3& H_ray_board);

/// Pose of a target seen by any lens: unprojects the pixels, then a homography (points in one plane, n >= 4)
/// or a DLT (n >= 6 not coplanar), then a few Gauss-Newton steps on the angular error of the rays. Pixels
/// outside the lens' domain are left out. kDegenerate: too few points, all on a line. \param p_board  n
/// points [m]   \param px  n pixels
Result<SE3> pose_from_points(const Lens& lens, std::span<const Vec3> p_board, std::span<const Vec2> px);

}  // namespace plumbline
