// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <numbers>

#include "plumbline/core/random.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/rectify/rectify.hpp"

namespace plumbline::test {

inline constexpr double kDegree = std::numbers::pi / 180;

inline Camera perspective(const std::string& name, double k1 = -0.28) {
  return {name, {640, 480}, OpenCV5{532, 533, 342, 235, {k1, 0.05, 0.001, -0.0005, 0.02}}};
}

/// A kb4 camera whose image circle of full field of view `fov_deg` just fits the image's width.
inline Camera fisheye(const std::string& name, double fov_deg, ImageSize size = {800, 600}) {
  const double t = 0.5 * fov_deg * kDegree, k1 = -0.01, k2 = 0.002;
  const double f = 0.5 * size.width / (t * (1 + k1 * t * t + k2 * t * t * t * t));
  return {name, size, KannalaBrandt4{f, 1.01 * f, 0.5 * size.width + 3, 0.5 * size.height - 4, k1, k2, 0, 0}};
}

/// Camera 2 stands at `centre_m` in the first camera's frame, turned by the rotation vector w [rad]: p_1 =
/// exp(w) p_2 + c.
inline Rig pair(const Camera& a, const Camera& b, const Vec3& centre_m, const Vec3& w) {
  return {{a, b}, {SE3(), SE3(so3_exp(w), centre_m).inverse()}};
}

/// Where camera `which` of the rectified pair shows a point of the rig's frame; nullopt behind the plane.
inline std::optional<Vec2> rectified_px(const Rig& rig, const StereoRectification& r, int which,
                                        const Vec3& p_rig) {
  const Vec3 p = r.R_rect_cam[which] * (rig.T_cam_rig[which] * p_rig);
  if (!(p.z() > 0)) return std::nullopt;
  return Vec2((r.P[which].leftCols<3>() * p).hnormalized());
}

}  // namespace plumbline::test
