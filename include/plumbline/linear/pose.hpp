// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"
#include "plumbline/linear/ransac.hpp"

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

/// Pose T_cam_world from n >= 6 points that are not coplanar and their unit rays, any z: the camera matrix
/// onto the rays by DLT (camera_matrix_to_rays()), the rotation nearest to its left block, and at most five
/// steps of the ray equations linearised there, which take the error of a DLT to that of the best estimate
/// (one step does to first order: Le Cam's one-step estimator). Unequal numbers throw std::invalid_argument.
/// \returns kDegenerate: fewer than 6 points, coplanar points (or all but one), rays in one plane, points and
///          camera on a twisted cubic, rays of a mirror image of the points; kInvalidData for NaN
Result<SE3> pose_linear(std::span<const Vec3> p_world, std::span<const Vec3> rays_cam);

/// One of the poses that explain the image of a board.
struct PlanarPose {
  SE3 T_cam_board;
  double rms_rad = 0;  ///< root mean square angle between the rays and the points' directions [rad]
};
/// A flat board seen from afar looks nearly the same when its normal is mirrored at the line of sight.
struct PlanarPoses {
  PlanarPose best;                  ///< with the smaller error
  std::optional<PlanarPose> other;  ///< nullopt where the error has no second minimum (strong perspective)
};

/// Both poses of n >= 4 points of one plane, anywhere in the board's frame, that are local minima of the
/// angles to their unit rays (any z): the two closed solutions of the homography's derivative at the centroid
/// (Collins & Bartoli, "Infinitesimal plane-based pose estimation", IJCV 2014, section 3), each polished by
/// Gauss-Newton steps. When other->rms_rad is not clearly larger than best.rms_rad the image does not tell
/// them apart. Unequal numbers throw std::invalid_argument.
/// \returns kDegenerate: fewer than 4 points, points on a line (or all but one), points thicker than 5 % of
///          their extent, a board seen edge-on; kInvalidData for NaN
Result<PlanarPoses> pose_planar(std::span<const Vec3> p_board, std::span<const Vec3> rays_cam);

/// Pose T_cam_world of any lens from correspondences of which some are wrong: p3p() on random triples, kept
/// where most points agree, refitted to the pixels of those (see RansacOptions). A correspondence is an
/// inlier when the lens projects its point to within options.inlier_px of its pixel; a point that does not
/// project, a pixel that has no ray, and a NaN are outliers. refine_pose() of refine/pose.hpp on the inliers
/// gives the covariance.
/// \param p_world  n points [m]
/// \param px  n pixels; unequal numbers throw std::invalid_argument
/// \returns kDegenerate: fewer than 4 usable points, points on a line, inliers that are fewer than 4 or on a
///          line, or so few that chance alone would find a pose with as many
Result<Found<SE3>> pose_ransac(const Lens& lens, std::span<const Vec3> p_world, std::span<const Vec2> px,
                               const RansacOptions& options);

}  // namespace plumbline
