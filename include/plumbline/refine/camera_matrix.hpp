// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

namespace plumbline {

/// A camera matrix that minimises the geometric error, with its uncertainty.
struct RefinedCameraMatrix {
  Mat34 P;  ///< |P| = 1 (Frobenius), positive depth of most points
  /// 12x12, of P's entries row by row at |P| = 1: rank 11, its null vector is P itself. For errors of
  /// sigma_px in each coordinate of each pixel, to first order.
  Eigen::Matrix<double, 12, 12> covariance;
  double rms_px;  ///< root mean square distance of pixels and images
  int iterations;
};

/// Minimises  sum |px - image(P p_world)|^2  over the 11 degrees of freedom of P, from a start such as
/// camera_matrix(): maximum likelihood for independent errors of the pixels (the Gold Standard of Hartley &
/// Zisserman 2004, algorithm 7.1). Levenberg-Marquardt on the unit sphere of P in normalised coordinates.
/// \param start_P  of any scale and sign; each point stays on the side of the camera that it is on in the
/// start \param p_world  n >= 6 points, any unit, not coplanar \param px  n pixels; fewer than 6, unequal
/// numbers or sigma_px <= 0 throw std::invalid_argument \returns kDegenerate when the points do not determine
/// P (normal equations of unit diagonal with an eigenvalue
///          below 1e-13 of the largest), kNotConverged, or kInvalidData for NaN or a start that puts a point
///          on its principal plane
Result<RefinedCameraMatrix> refine_camera_matrix(const Mat34& start_P, std::span<const Vec3> p_world,
                                                 std::span<const Vec2> px, double sigma_px);

}  // namespace plumbline
