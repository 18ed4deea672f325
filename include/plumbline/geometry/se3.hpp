// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>

#include "plumbline/core/types.hpp"

namespace plumbline {

/// A rigid transform T_a_b: p_a = T_a_b * p_b, and T_a_c = T_a_b * T_b_c (adjacent frame names match).
/// Stored as one block of seven doubles [qw qx qy qz | tx ty tz]: unit quaternion, translation [m].
struct SE3 {
  std::array<double, 7> qt{1, 0, 0, 0, 0, 0, 0};

  SE3() = default;
  /// \pre R is a rotation to 1e-5 in the Frobenius norm of R'R - I (it is renormalised); throws
  /// std::invalid_argument otherwise.
  SE3(const Mat3& R, const Vec3& t_m);

  Mat3 R() const;
  Vec3 t() const { return {qt[4], qt[5], qt[6]}; }
  Mat34 matrix34() const;
  Mat4 matrix() const;

  /// T_b_a of this T_a_b: [R' | -R' t].
  SE3 inverse() const;
  /// Where the origin of frame a lies, seen in frame b: the camera centre of T_cam_world, -R' t [m].
  Vec3 centre() const { return inverse().t(); }

  Vec3 operator*(const Vec3& p) const;
  SE3 operator*(const SE3& other) const;
  bool operator==(const SE3&) const = default;
};

/// exp of [rotation w (rad) | translation v (m)]: R = exp(w), t = J_l(w) v (Sola et al. 2018, eq. 172).
SE3 se3_exp(const Vec6& xi);

/// Inverse of se3_exp, rotation part in [0, pi].
Vec6 se3_log(const SE3& T);

/// Ad(T): T exp(xi) T^-1 = exp(Ad(T) xi), in the order [rotation | translation].
Mat6 se3_adjoint(const SE3& T);

/// exp(xi + d) = exp(J_l(xi) d) exp(xi) to first order; the right Jacobian is J_l(-xi). Barfoot 2017,
/// eq. 7.85.
Mat6 se3_left_jacobian(const Vec6& xi);
Mat6 se3_right_jacobian(const Vec6& xi);

/// Inverses of the above, in closed form (Barfoot 2017, eq. 7.95). \pre |w| < 2 pi
Mat6 se3_left_jacobian_inverse(const Vec6& xi);
Mat6 se3_right_jacobian_inverse(const Vec6& xi);

/// The step that every iteration of the library takes: R <- exp(dw) R, t <- t + dt, for d = [dw (rad) | dt
/// (m)]. Rotation and translation are stepped apart (SO(3) x R^3), which keeps the Jacobian of a moved point
/// simple: d(T p)/d[dw | dt] = [-[R p]_x | I].
SE3 box_plus(const SE3& T, const Vec6& d);

/// The d with box_plus(a, d) == b.
Vec6 box_minus(const SE3& b, const SE3& a);

}  // namespace plumbline
