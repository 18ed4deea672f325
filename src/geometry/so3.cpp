// SPDX-License-Identifier: Apache-2.0
#include "plumbline/geometry/so3.hpp"

#include <cmath>
#include <numbers>

#include "plumbline/core/check.hpp"

namespace plumbline {
namespace {

// Below this angle the series is exact to double precision (next terms are below theta^6 / 5040).
constexpr double kSmallAngle = 1e-2;

struct Coefficients {
  double a;  // sin(t) / t
  double b;  // (1 - cos(t)) / t^2
  double c;  // (t - sin(t)) / t^3
};

Coefficients coefficients(double t) {
  const double t2 = t * t;
  if (t < kSmallAngle) {
    return {1 - t2 / 6 * (1 - t2 / 20 * (1 - t2 / 42)), 0.5 * (1 - t2 / 12 * (1 - t2 / 30 * (1 - t2 / 56))),
            1.0 / 6 * (1 - t2 / 20 * (1 - t2 / 42 * (1 - t2 / 72)))};
  }
  const double half = std::sin(0.5 * t);  // 1 - cos(t) = 2 sin^2(t/2) does not cancel
  return {std::sin(t) / t, 2 * half * half / t2, (t - std::sin(t)) / (t2 * t)};
}

}  // namespace

Mat3 skew(const Vec3& w) {
  Mat3 W;
  W << 0, -w.z(), w.y(), w.z(), 0, -w.x(), -w.y(), w.x(), 0;
  return W;
}

Mat3 so3_exp(const Vec3& w) {
  const Coefficients k = coefficients(w.norm());
  const Mat3 W = skew(w);
  return Mat3::Identity() + k.a * W + k.b * W * W;
}

Vec3 so3_log(const Mat3& R) {
  PLUMBLINE_CHECK((R.transpose() * R - Mat3::Identity()).norm() < 1e-5 && R.determinant() > 0,
                  "so3_log needs a rotation matrix");
  // Through the quaternion with the largest component first (Shepperd 1978): no division by a small number.
  Eigen::Quaterniond q(R);
  q.normalize();
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const double sine = q.vec().norm();  // sin(theta / 2)
  if (sine < 1e-8) return 2.0 / q.w() * q.vec();
  return 2.0 * std::atan2(sine, q.w()) / sine * q.vec();
}

Mat3 so3_left_jacobian(const Vec3& w) {
  const Coefficients k = coefficients(w.norm());
  const Mat3 W = skew(w);
  return Mat3::Identity() + k.b * W + k.c * W * W;
}

Mat3 so3_right_jacobian(const Vec3& w) { return so3_left_jacobian(-w); }

Mat3 so3_left_jacobian_inverse(const Vec3& w) {
  const double t = w.norm(), t2 = t * t;
  PLUMBLINE_CHECK(t < 2 * std::numbers::pi, "so3_left_jacobian_inverse needs |w| < 2 pi");
  // 1/t^2 - (1 + cos t) / (2 t sin t) = (1 - (t/2) cot(t/2)) / t^2
  const double d = t < kSmallAngle ? 1.0 / 12 * (1 + t2 / 60 * (1 + t2 / 42))
                                   : (1 - 0.5 * t * std::cos(0.5 * t) / std::sin(0.5 * t)) / t2;
  const Mat3 W = skew(w);
  return Mat3::Identity() - 0.5 * W + d * W * W;
}

Mat3 so3_right_jacobian_inverse(const Vec3& w) { return so3_left_jacobian_inverse(-w); }

double rotation_angle(const Mat3& R) { return so3_log(R).norm(); }

}  // namespace plumbline
