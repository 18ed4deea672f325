// SPDX-License-Identifier: Apache-2.0
#include "plumbline/geometry/se3.hpp"

#include <cmath>

#include "plumbline/core/check.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline {
namespace {

Eigen::Quaterniond rotation_of(const SE3& T) { return {T.qt[0], T.qt[1], T.qt[2], T.qt[3]}; }

void set(SE3& T, const Eigen::Quaterniond& q, const Vec3& t) {
  T.qt = {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()};
}

// The lower-left block of the left Jacobian of SE(3), Barfoot 2017, eq. 7.86.
Mat3 left_jacobian_q(const Vec3& w, const Vec3& v) {
  const double t = w.norm(), t2 = t * t;
  const Mat3 W = skew(w), V = skew(v);
  double a, b, c;
  if (t < 0.1) {  // Taylor series: the closed forms cancel to 0/0 like eps / t^5
    a = 1.0 / 6 * (1 - t2 / 20 * (1 - t2 / 42 * (1 - t2 / 72)));
    b = 1.0 / 24 * (1 - t2 / 30 * (1 - t2 / 56 * (1 - t2 / 90)));
    c = 1.0 / 120 * (1 - t2 / 21 * (1 - t2 / 48 * (1 - t2 * 2.0 / 165)));
  } else {
    const double s = std::sin(t), k = std::cos(t);
    a = (t - s) / (t2 * t);
    b = (t2 / 2 + k - 1) / (t2 * t2);
    c = (2 * t - 3 * s + t * k) / (2 * t2 * t2 * t);
  }
  return 0.5 * V + a * (W * V + V * W + W * V * W) + b * (W * W * V + V * W * W - 3 * W * V * W) +
         c * (W * V * W * W + W * W * V * W);
}

}  // namespace

SE3::SE3(const Mat3& R, const Vec3& t_m) {
  PLUMBLINE_CHECK((R.transpose() * R - Mat3::Identity()).norm() < 1e-5 && R.determinant() > 0,
                  "SE3 needs a rotation matrix");
  Eigen::Quaterniond q(R);
  q.normalize();
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  set(*this, q, t_m);
}

Mat3 SE3::R() const { return rotation_of(*this).toRotationMatrix(); }

Mat34 SE3::matrix34() const {
  Mat34 M;
  M << R(), t();
  return M;
}

Mat4 SE3::matrix() const {
  Mat4 M = Mat4::Identity();
  M.topRows<3>() = matrix34();
  return M;
}

SE3 SE3::inverse() const {
  const Eigen::Quaterniond q = rotation_of(*this).conjugate();
  SE3 result;
  set(result, q, -(q * t()));
  return result;
}

Vec3 SE3::operator*(const Vec3& p) const { return rotation_of(*this) * p + t(); }

SE3 SE3::operator*(const SE3& other) const {
  Eigen::Quaterniond q = rotation_of(*this) * rotation_of(other);
  q.normalize();
  SE3 result;
  set(result, q, *this * other.t());
  return result;
}

SE3 se3_exp(const Vec6& xi) {
  const Vec3 w = xi.head<3>();
  return {so3_exp(w), so3_left_jacobian(w) * xi.tail<3>()};
}

Vec6 se3_log(const SE3& T) {
  const Vec3 w = so3_log(T.R());
  Vec6 xi;
  xi << w, so3_left_jacobian_inverse(w) * T.t();
  return xi;
}

Mat6 se3_adjoint(const SE3& T) {
  Mat6 A = Mat6::Zero();
  A.topLeftCorner<3, 3>() = A.bottomRightCorner<3, 3>() = T.R();
  A.bottomLeftCorner<3, 3>() = skew(T.t()) * T.R();
  return A;
}

Mat6 se3_left_jacobian(const Vec6& xi) {
  const Vec3 w = xi.head<3>(), v = xi.tail<3>();
  Mat6 J = Mat6::Zero();
  J.topLeftCorner<3, 3>() = J.bottomRightCorner<3, 3>() = so3_left_jacobian(w);
  J.bottomLeftCorner<3, 3>() = left_jacobian_q(w, v);
  return J;
}

Mat6 se3_right_jacobian(const Vec6& xi) { return se3_left_jacobian(-xi); }

Mat6 se3_left_jacobian_inverse(const Vec6& xi) {
  const Vec3 w = xi.head<3>(), v = xi.tail<3>();
  const Mat3 J = so3_left_jacobian_inverse(w);
  Mat6 inverse = Mat6::Zero();
  inverse.topLeftCorner<3, 3>() = inverse.bottomRightCorner<3, 3>() = J;
  inverse.bottomLeftCorner<3, 3>() = -J * left_jacobian_q(w, v) * J;
  return inverse;
}

Mat6 se3_right_jacobian_inverse(const Vec6& xi) { return se3_left_jacobian_inverse(-xi); }

SE3 box_plus(const SE3& T, const Vec6& d) {
  const Vec3 w = d.head<3>();
  const double angle = w.norm(), half = 0.5 * angle;
  const double k = angle < 1e-6 ? 0.5 - angle * angle / 48 : std::sin(half) / angle;
  const Eigen::Quaterniond dq(std::cos(half), k * w.x(), k * w.y(), k * w.z());
  Eigen::Quaterniond q = dq * rotation_of(T);
  q.normalize();
  SE3 result;
  set(result, q, T.t() + d.tail<3>());
  return result;
}

Vec6 box_minus(const SE3& b, const SE3& a) {
  Vec6 d;
  d << so3_log((rotation_of(b) * rotation_of(a).conjugate()).toRotationMatrix()), b.t() - a.t();
  return d;
}

}  // namespace plumbline
