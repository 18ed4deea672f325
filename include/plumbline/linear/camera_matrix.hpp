// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/geometry/se3.hpp"

namespace plumbline {

/// Camera matrix from 3-D/2-D correspondences: normalised DLT (Hartley & Zisserman 2004, alg. 7.1).
/// Solves  w [px; 1] = P [p_world; 1],  P fixed to ||P(2, 0:2)|| = 1 and positive depth of the points.
/// \param p_world  n >= 6 points, any unit, NOT coplanar
/// \param px  n pixels [px]; fewer than 6, or unequal numbers, throw std::invalid_argument
/// \returns P (3x4); kDegenerate when the points, or all but one, lie in a plane to 1e-6 of their
///          extent, or the null space of the normalised system has more than one dimension
///          (sigma_11 < 1e-9 sigma_1: a plane and a line through the camera, a twisted cubic through
///          the camera), also with noise: when n >= 8 and a second camera matrix fits within three times the
///          error of the best; kInvalidData for NaN
Result<Mat34> camera_matrix(std::span<const Vec3> p_world, std::span<const Vec2> px);

/// The same onto rays: P = [R | t] from n >= 6 points and unit rays of a known lens, any z, scaled to
/// |det| = 1 of its left block and  ray ~ P [p; 1]  with positive factors. The left block is a
/// rotation only as far as noise allows.
Result<Mat34> camera_matrix_to_rays(std::span<const Vec3> p_world, std::span<const Vec3> rays_cam);

/// P = K [R | t] = K R [I | -C].
struct CameraMatrixParts {
  Mat3 K;       ///< upper triangular, positive diagonal, K(2,2) = 1
  Mat3 R;       ///< R_cam_world, det +1
  Vec3 t;       ///< t_cam_world [unit of the world]
  Vec3 centre;  ///< C, the camera centre in the world: the null vector of P, dehomogenised
  SE3 T_cam_world() const { return {R, t}; }
};

/// Decomposes P by RQ (Hartley & Zisserman 2004, A4.1.1), any scale and sign of P. kDegenerate when the left
/// 3x3 block is singular (a camera at infinity).
Result<CameraMatrixParts> decompose_camera_matrix(const Mat34& P);

/// The same by the QR decomposition of M^-1 = R' K^-1, M the left 3x3 block of P. As good as RQ to some
/// 1e-12; there to be compared with it. kDegenerate as decompose_camera_matrix.
Result<CameraMatrixParts> decompose_camera_matrix_qr(const Mat34& P);

/// The same by Cholesky's factor of  M M' = K K'  (the dual image of the absolute conic, Hartley & Zisserman
/// 2004, section 8.5), then R = K^-1 M. Squares M: loses twice the digits of the others when rows of M are
/// nearly parallel, and refuses (kDegenerate) below a sine of 1e-7 between them.
Result<CameraMatrixParts> decompose_camera_matrix_cholesky(const Mat34& P);

/// M = U Q with U upper triangular with a positive diagonal and Q orthogonal (det Q = sign of det M).
/// kDegenerate for a singular M.
struct Rq {
  Mat3 upper, orthogonal;
};
Result<Rq> rq_decompose(const Mat3& M);

/// The camera centre as the null vector of P, homogeneous [C; w], unit length; w = 0 for a camera at
/// infinity.
Vec4 camera_centre(const Mat34& P);

/// The camera centre as -M^-1 p4 (Hartley & Zisserman 2004, section 6.2.4), the second road to it.
/// kDegenerate as decompose_camera_matrix.
Result<Vec3> camera_centre_by_inverse(const Mat34& P);

}  // namespace plumbline
