// SPDX-License-Identifier: Apache-2.0
#include "plumbline/geometry/rotation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <string>

#include "plumbline/core/check.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline {
namespace {

constexpr double kPi = std::numbers::pi;
// Below this distance from lock the third angle is set to 0, which changes R by at most as much.
constexpr double kLock = 1e-13;

constexpr std::array<std::string_view, 12> kNames{"XYX", "XYZ", "XZX", "XZY", "YXY", "YXZ",
                                                  "YZX", "YZY", "ZXY", "ZXZ", "ZYX", "ZYZ"};

struct Axes {
  int first, second, third;
};

Axes axes(EulerOrder order) {
  const std::string_view name = to_string(order);
  return {name[0] - 'X', name[1] - 'X', name[2] - 'X'};
}

Mat3 turn(int axis, double angle_rad) {
  const int j = (axis + 1) % 3, k = (axis + 2) % 3;
  Mat3 R = Mat3::Identity();
  R(j, j) = R(k, k) = std::cos(angle_rad);
  R(k, j) = std::sin(angle_rad);
  R(j, k) = -R(k, j);
  return R;
}

double wrapped(double angle_rad) {
  const double a = std::remainder(angle_rad, 2 * kPi);
  return a <= -kPi ? kPi : a;
}

Eigen::Quaterniond unit_quaternion(const Mat3& R, const char* text) {
  PLUMBLINE_CHECK((R.transpose() * R - Mat3::Identity()).norm() < 1e-5 && R.determinant() > 0, text);
  Eigen::Quaterniond q(R);
  q.normalize();
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  return q;
}

}  // namespace

std::string_view to_string(EulerOrder order) {
  const auto index = static_cast<std::size_t>(order);
  PLUMBLINE_CHECK(index < kNames.size(), "not an EulerOrder");
  return kNames[index];
}

Result<EulerOrder> parse_euler_order(std::string_view text) {
  std::string capitals(text), known;
  for (char& c : capitals) {
    if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
  }
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    if (kNames[i] == capitals) return static_cast<EulerOrder>(i);
    known += (known.empty() ? "" : ", ") + std::string(kNames[i]);
  }
  return Error{ErrorCode::kUnsupported,
               fmt::format("'{}' is no order of Euler angles; use one of {}", text, known), "Euler angles"};
}

Mat3 rotation_from_euler(EulerOrder order, const Vec3& angles_rad) {
  const Axes a = axes(order);
  return turn(a.first, angles_rad[0]) * turn(a.second, angles_rad[1]) * turn(a.third, angles_rad[2]);
}

EulerAngles euler_from_rotation(EulerOrder order, const Mat3& R) {
  const auto [a, b, c] = axes(order);
  const int k = 3 - a - b;                     // the axis that completes a and b ...
  const double e = b == (a + 1) % 3 ? 1 : -1;  // ... to a x b = e k
  Eigen::Quaterniond q = unit_quaternion(R, "euler_from_rotation needs a rotation matrix");
  // A quarter turn about b carries a to -e k, hence R_k(g) = R_b(pi/2) R_a(-e g) R_b(-pi/2) and
  // R R_b(pi/2) = R_a(angle 0) R_b(angle 1 + pi/2) R_a(-e angle 2).
  if (c != a) {
    const Vec3 quarter = std::sqrt(0.5) * Vec3::Unit(b);
    q = q * Eigen::Quaterniond(std::sqrt(0.5), quarter.x(), quarter.y(), quarter.z());
  }
  // R_a(s + d) R_b(m) R_a(s - d) has the quaternion
  // [cos(m/2) cos s, a: cos(m/2) sin s, b: sin(m/2) cos d, k: e sin(m/2) sin d].
  const double w = q.w(), qa = q.vec()[a], qb = q.vec()[b], qk = e * q.vec()[k];
  const double cosine = std::hypot(w, qa), sine = std::hypot(qb, qk);
  EulerAngles out;
  out.from_lock_rad = 2 * std::atan2(std::min(sine, cosine), std::max(sine, cosine));
  out.gimbal_lock = out.from_lock_rad < kLock;
  double half_sum = std::atan2(qa, w), half_difference = std::atan2(qk, qb);
  if (out.gimbal_lock)
    (sine < cosine ? half_difference : half_sum) = sine < cosine ? half_sum : half_difference;
  double third = half_sum - half_difference;
  if (c != a) third = -e * third;
  out.angles_rad = {wrapped(half_sum + half_difference),
                    2 * std::atan2(sine, cosine) - (c != a ? kPi / 2 : 0.0), wrapped(third)};
  return out;
}

Vec4 quaternion_from_rotation(const Mat3& R) {
  const Eigen::Quaterniond q = unit_quaternion(R, "quaternion_from_rotation needs a rotation matrix");
  return {q.w(), q.x(), q.y(), q.z()};
}

Mat3 rotation_from_quaternion(const Vec4& wxyz) {
  const double length = wxyz.norm();
  PLUMBLINE_CHECK(length > 0 && std::isfinite(length),
                  "rotation_from_quaternion needs a quaternion, not zero");
  const Vec4 q = wxyz / length;
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix();
}

AxisAngle axis_angle_from_rotation(const Mat3& R) {
  const Eigen::Quaterniond q = unit_quaternion(R, "axis_angle_from_rotation needs a rotation matrix");
  const double sine = q.vec().stableNorm();
  if (!(sine > 0)) return {};
  return {q.vec() / sine, 2 * std::atan2(sine, q.w())};
}

Mat3 rotation_from_axis_angle(const AxisAngle& axis_angle) {
  if (axis_angle.angle_rad == 0) return Mat3::Identity();
  const double length = axis_angle.axis.norm();
  PLUMBLINE_CHECK(length > 0 && std::isfinite(length), "rotation_from_axis_angle needs an axis, not zero");
  // Within half a turn the rotation vector keeps all digits of the angle.
  return so3_exp(std::remainder(axis_angle.angle_rad, 2 * kPi) / length * axis_angle.axis);
}

}  // namespace plumbline
