// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/rotation_only.hpp"

#include <fmt/format.h>

#include <cmath>

#include "plumbline/core/linalg.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "rotation between two views";
// Second largest plus (signed) smallest singular value of the rays' moments, over the largest: the square of
// the rays' spread [rad]. Rounding turns rays that are closer than 1e-6 rad by more than 1e-10 rad of it.
constexpr double kParallel = 1e-12;

}  // namespace

Mat3 rotation_homography(const Mat3& K1, const Mat3& K2, const Mat3& R_2_1) {
  return K2 * R_2_1 * K1.inverse();
}

Result<RotationOnly> rotation_from_homography(const Mat3& H, const Mat3& K1, const Mat3& K2,
                                              double tolerance) {
  PLUMBLINE_CHECK(tolerance > 0, "rotation_from_homography needs a tolerance above 0");
  const Mat3 A = K2.inverse() * H * K1;
  if (!A.allFinite()) return Error{ErrorCode::kInvalidData, "H, K1 or K2 is not finite", kWhere};
  const Svd3 d = svd3(A);
  if (!(d.s[2] > 1e-12 * d.s[0])) {
    return Error{ErrorCode::kDegenerate,
                 fmt::format("the homography is singular (singular value ratio {:.2g}, at least 1e-12 is "
                             "needed); it is that of no rotation",
                             d.s[0] > 0 ? d.s[2] / d.s[0] : 0.0),
                 kWhere};
  }
  // The determinant, +1 for a rotation, takes scale and sign out together.
  const double sign = std::copysign(1.0, A.determinant()), scale = 1 / std::cbrt(d.s.prod());
  RotationOnly result{sign * d.U * d.V.transpose(), (scale * d.s - Vec3::Ones()).cwiseAbs().maxCoeff()};
  if (!(result.residual <= tolerance)) {
    return Error{
        ErrorCode::kInvalidData,
        fmt::format("translation: the homography is not that of a pure rotation (its singular values "
                    "differ from 1 by {:.2g}, at most {:.2g} is allowed); the camera moved before a "
                    "plane (plane_motions), or K1 or K2 is wrong",
                    result.residual, tolerance),
        kWhere};
  }
  return result;
}

Result<RotationOnly> rotation_from_rays(std::span<const Vec3> rays_1, std::span<const Vec3> rays_2) {
  PLUMBLINE_CHECK(rays_1.size() == rays_2.size() && rays_1.size() >= 2,
                  "rotation_from_rays needs as many rays of camera 1 as of camera 2, 2 or more");
  Mat3 moments = Mat3::Zero();
  for (std::size_t i = 0; i < rays_1.size(); ++i) moments += rays_2[i] * rays_1[i].transpose();
  if (!moments.allFinite()) {
    return Error{ErrorCode::kInvalidData, "a ray is not finite; remove that pixel", kWhere};
  }
  const Svd3 d = svd3(moments);
  const double handed = (d.U * d.V.transpose()).determinant() < 0 ? -1 : 1;
  const double determined = d.s[0] > 0 ? (d.s[1] + handed * d.s[2]) / d.s[0] : 0.0;
  if (!(determined > kParallel)) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("the {} rays are parallel (squared spread {:.2g}, at least {:.0e} is needed): the "
                    "turn about them is not determined; use points farther apart",
                    rays_1.size(), determined, kParallel),
        kWhere};
  }
  const Mat3 R = d.U * Vec3(1, 1, handed).asDiagonal() * d.V.transpose();
  double sum = 0;
  for (std::size_t i = 0; i < rays_1.size(); ++i) {
    const Vec3 turned = R * rays_1[i];
    const double angle = std::atan2(turned.cross(rays_2[i]).norm(), turned.dot(rays_2[i]));
    sum += angle * angle;
  }
  return RotationOnly{R, std::sqrt(sum / static_cast<double>(rays_1.size()))};
}

}  // namespace plumbline
