// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"

namespace plumbline {

/// A pose with what its pixels say of its uncertainty.
struct RefinedPose {
  SE3 T_cam_world;
  Mat6 covariance;     ///< of the step d = [rotation (rad) | translation (unit of the world)] in
                       ///< truth = box_plus(T_cam_world, d)
  double rms_px = 0;   ///< root mean square of the reprojection errors' lengths [px]
  int iterations = 0;  ///< steps tried
};

/// The pose T_cam_world that minimises the reprojection error  sum |lens(T p_i) - px_i|^2  by
/// Levenberg-Marquardt, any lens, lens held fixed: the maximum-likelihood pose under equal, independent,
/// normal noise of the pixel coordinates, with its covariance to first order (J'J)^-1 sigma_px^2 (Hartley &
/// Zisserman 2004, result 5.9). Outliers are not looked for: give it the inliers of pose_ransac().
/// \param start  near the answer, as pose_from_points(), pose_planar() or pose_ransac() give it
/// \param p_world  n >= 3 points, not on a line [unit of the world]
/// \param px  n pixels; unequal numbers throw std::invalid_argument
/// \param sigma_px  standard deviation of each pixel coordinate, > 0 [px]
/// \returns kDegenerate: fewer than three points, or points that do not determine the pose (on a line, or the
///          camera on the danger cylinder of three); kInvalidData: a point that the lens does not see from
///          `start`, or a NaN; kNotConverged after 100 steps
Result<RefinedPose> refine_pose(const SE3& start, const Lens& lens, std::span<const Vec3> p_world,
                                std::span<const Vec2> px, double sigma_px);

}  // namespace plumbline
