// SPDX-License-Identifier: Apache-2.0
#include "plumbline/geometry/image_formation.hpp"

#include <cmath>
#include <limits>

#include "plumbline/core/check.hpp"

namespace plumbline {
namespace {

double checked_determinant(const Mat34& P) {
  const double det = P.leftCols<3>().determinant();
  PLUMBLINE_CHECK(P.allFinite() && det != 0, "a camera matrix with a regular left 3x3 block is needed");
  return det;
}

}  // namespace

Mat34 compose_camera_matrix(const Mat3& K, const SE3& T_cam_world) { return K * T_cam_world.matrix34(); }

std::optional<ImagePoint> image_of(const Mat34& P, const Vec3& p_world) {
  const double det = checked_determinant(P);
  const Vec4 X = p_world.homogeneous();
  const Vec3 x = P * X;
  const double rounding = 4 * std::numeric_limits<double>::epsilon() * P.row(2).cwiseAbs().dot(X.cwiseAbs());
  if (!(std::abs(x.z()) > rounding)) return std::nullopt;
  return ImagePoint{x.hnormalized(), std::copysign(1.0, det) * x.z() / P.row(2).head<3>().norm()};
}

double signed_depth(const Mat34& P, const Vec4& p_world_h) {
  const double det = checked_determinant(P);
  return std::copysign(1.0, det) * P.row(2).dot(p_world_h) / (p_world_h.w() * P.row(2).head<3>().norm());
}

}  // namespace plumbline
