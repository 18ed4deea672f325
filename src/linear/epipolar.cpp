// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/epipolar.hpp"

#include <cmath>

#include "plumbline/core/linalg.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline {
namespace {

Vec3 normalised_line(const Vec3& line) {
  const double n = std::hypot(line.x(), line.y());
  if (n > 0) return line / n;
  return line.z() == 0 ? Vec3(Vec3::Zero()) : Vec3(Vec3::UnitZ());
}

// Both epipolar lines of a pair and how far it is from fulfilling F.
struct Pair {
  Vec2 normal_1, normal_2;
  double value;
};

Pair pair_of(const Mat3& F, const Vec2& px1, const Vec2& px2) {
  const Vec3 l2 = F * px1.homogeneous(), l1 = F.transpose() * px2.homogeneous();
  return {l1.head<2>(), l2.head<2>(), px2.homogeneous().dot(l2)};
}

}  // namespace

Epipoles epipoles(const Mat3& F) {
  const Svd3 d = svd3(F);
  return {d.V.col(2), d.U.col(2)};
}

Vec3 epipolar_line_2(const Mat3& F, const Vec2& px1) { return normalised_line(F * px1.homogeneous()); }

Vec3 epipolar_line_1(const Mat3& F, const Vec2& px2) {
  return normalised_line(F.transpose() * px2.homogeneous());
}

double sampson_distance(const Mat3& F, const Vec2& px1, const Vec2& px2) {
  const Pair p = pair_of(F, px1, px2);
  const double slope2 = p.normal_1.squaredNorm() + p.normal_2.squaredNorm();
  return slope2 > 0 ? std::abs(p.value) / std::sqrt(slope2) : 0.0;
}

double symmetric_epipolar_distance(const Mat3& F, const Vec2& px1, const Vec2& px2) {
  const Pair p = pair_of(F, px1, px2);
  if (p.value == 0) return 0;
  return std::abs(p.value) * std::sqrt(0.5 * (1 / p.normal_1.squaredNorm() + 1 / p.normal_2.squaredNorm()));
}

Mat3 fundamental_from_essential(const Mat3& E, const Mat3& K1, const Mat3& K2) {
  const Mat3 F = K2.inverse().transpose() * E * K1.inverse();
  return F / F.norm();
}

Mat3 essential_from_fundamental(const Mat3& F, const Mat3& K1, const Mat3& K2) {
  const Svd3 d = svd3(K2.transpose() * F * K1);
  return d.U * Vec3(1, 1, 0).asDiagonal() * d.V.transpose();
}

Mat3 essential_from_pose(const SE3& T_2_1) { return skew(T_2_1.t()) * T_2_1.R(); }

Mat3 fundamental_from_cameras(const Mat34& P1, const Mat34& P2) {
  // Rows of unit length, so that the determinants are volumes between 0 and 1.
  const Vec3 s1 = P1.rowwise().norm(), s2 = P2.rowwise().norm();
  const Mat34 A = s1.cwiseInverse().asDiagonal() * P1, B = s2.cwiseInverse().asDiagonal() * P2;
  Mat3 F;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      Mat4 M;  // cyclic rows carry the sign of the cofactor
      M << A.row((i + 1) % 3), A.row((i + 2) % 3), B.row((j + 1) % 3), B.row((j + 2) % 3);
      F(j, i) = M.determinant();
    }
  }
  if (!(F.norm() > 1e-12)) return Mat3::Zero();
  F = s2.cwiseInverse().asDiagonal() * F * s1.cwiseInverse().asDiagonal();
  return F / F.norm();
}

std::pair<Mat34, Mat34> canonical_cameras(const Mat3& F) {
  const Vec3 e2 = epipoles(F).e2;
  Mat34 P1 = Mat34::Identity(), P2;
  P2 << skew(e2) * F, e2;
  return {P1, P2};
}

}  // namespace plumbline
