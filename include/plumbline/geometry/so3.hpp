// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "plumbline/core/types.hpp"

/// SO(3) as 3x3 rotation matrices, with rotation vectors w [rad] as its tangent space.
/// Source: Sola, Deray, Atchuthan, "A micro Lie theory for state estimation in robotics" (2018), appendix B.
namespace plumbline {

/// [w]_x, so that skew(w) * v = w x v.
Mat3 skew(const Vec3& w);

/// Rotation by |w| radians about w/|w| (Rodrigues). Exact near 0, where the closed form is 0/0.
Mat3 so3_exp(const Vec3& w);

/// The rotation vector of R with |w| in [0, pi]; exact near 0 and near pi.
/// \pre R is a rotation with |R'R - I| < 1e-5 and det > 0; throws std::invalid_argument otherwise.
Vec3 so3_log(const Mat3& R);

/// J_l: so3_exp(w + dw) = so3_exp(J_l(w) dw) so3_exp(w) to first order. The right Jacobian is J_l(-w).
Mat3 so3_left_jacobian(const Vec3& w);
Mat3 so3_right_jacobian(const Vec3& w);

/// Inverses of the above, in closed form. \pre |w| < 2 pi
Mat3 so3_left_jacobian_inverse(const Vec3& w);
Mat3 so3_right_jacobian_inverse(const Vec3& w);

/// Angle of the rotation in [0, pi], [rad].
double rotation_angle(const Mat3& R);

}  // namespace plumbline
