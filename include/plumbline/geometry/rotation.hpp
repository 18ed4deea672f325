// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string_view>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

/// The other ways to write a rotation down: Euler angles in any order, quaternion, axis and angle. Each is
/// exact near 0, near pi and near gimbal lock: what is read from R gives R again to rounding.
namespace plumbline {

/// The axes of the three turns, in the order in which the matrices are multiplied: kYXZ is
/// R = R_y(angles[0]) R_x(angles[1]) R_z(angles[2]). Read from the left each turn is about an axis of the
/// frame already turned (intrinsic); read from the right about the fixed axes (extrinsic, order reversed).
enum class EulerOrder { kXYX, kXYZ, kXZX, kXZY, kYXY, kYXZ, kYZX, kYZY, kZXY, kZXZ, kZYX, kZYZ };

/// "YXZ" and so on.
std::string_view to_string(EulerOrder order);

/// The order with this name, capitals or not; kUnsupported for any other text, with the twelve names.
Result<EulerOrder> parse_euler_order(std::string_view text);

/// R = R_a(angles[0]) R_b(angles[1]) R_c(angles[2]) for the axes a, b, c of the order; any angles [rad].
Mat3 rotation_from_euler(EulerOrder order, const Vec3& angles_rad);

/// Angles with rotation_from_euler(order, angles_rad) == R to rounding.
struct EulerAngles {
  /// First and third in (-pi, pi]; the second in [-pi/2, pi/2] for three different axes, in [0, pi] when the
  /// first and third axis are the same.
  Vec3 angles_rad;
  /// The first and third axis coincide, so that R fixes only the sum or the difference of their angles: the
  /// third angle is then set to 0.
  bool gimbal_lock = false;
  /// How far the second angle is from gimbal lock [rad]. The first and third angle are each uncertain by the
  /// error of R divided by this, although the rotation that they make together is not.
  double from_lock_rad = 0;
};

/// One routine for all orders: a half turn of the first axis into the third makes every order one with equal
/// outer axes, whose half sum and half difference are two angles of the quaternion's components (Shuster
/// 1993, section on Euler angles; Bernardes & Viollet 2022). Lock is named within 1e-13 rad, where setting
/// the third angle to 0 changes R by no more than that.
/// \pre R is a rotation to 1e-5 in the Frobenius norm of R'R - I; throws std::invalid_argument otherwise.
EulerAngles euler_from_rotation(EulerOrder order, const Mat3& R);

/// Unit quaternion [w x y z] (Hamilton's product), w >= 0. Shepperd (1978). \pre as euler_from_rotation
Vec4 quaternion_from_rotation(const Mat3& R);

/// R of a quaternion [w x y z] of any length but zero, which throws std::invalid_argument.
Mat3 rotation_from_quaternion(const Vec4& wxyz);

/// Rotation by angle_rad about a unit axis.
struct AxisAngle {
  Vec3 axis = Vec3::UnitZ();
  double angle_rad = 0;
};

/// Angle in [0, pi]; the axis of the identity is z. \pre as euler_from_rotation
AxisAngle axis_angle_from_rotation(const Mat3& R);

/// Any angle; an axis of any length but zero, which throws std::invalid_argument unless the angle is 0.
Mat3 rotation_from_axis_angle(const AxisAngle& axis_angle);

}  // namespace plumbline
