// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstddef>
#include <span>

#include "plumbline/core/check.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/geometry/se3.hpp"

namespace plumbline {

/// The poses that three points allow: 0 to 4 of them, on the stack, in no particular order.
class P3pSolutions {
 public:
  std::size_t size() const { return n_; }
  bool empty() const { return n_ == 0; }
  const SE3* begin() const { return poses_.data(); }
  const SE3* end() const { return poses_.data() + n_; }
  const SE3& operator[](std::size_t i) const {
    PLUMBLINE_CHECK(i < n_, "P3pSolutions: no such pose");
    return poses_[i];
  }
  /// \pre size() < 4
  void push_back(const SE3& T_cam_world) {
    PLUMBLINE_CHECK(n_ < poses_.size(), "P3pSolutions: three points allow four poses at most");
    poses_[n_++] = T_cam_world;
  }

 private:
  std::array<SE3, 4> poses_;
  std::size_t n_ = 0;
};

/// Every T_cam_world that puts three points onto their rays, before the camera along them: P3P for any
/// central lens. The distances l of the points along the rays satisfy three quadrics
///   l_i^2 + l_j^2 - 2 l_i l_j (ray_i . ray_j) = |p_i - p_j|^2;
/// two differences of them without constant terms are conics in l, a degenerate conic of their pencil is a
/// pair of lines (Persson & Nordberg, "Lambda Twist", ECCV 2018; the split into lines by the adjoint: Ding et
/// al., "Revisiting the P3P problem", CVPR 2023), and Newton's method on the quadrics polishes each
/// intersection. Nothing is allocated. A pose that does not solve the quadrics to rounding is not returned.
/// \param p_world  three points, any unit (that of the translation)
/// \param rays_cam  their unit rays in the camera frame, any z
/// \returns none when the points lie on a line (or two coincide) or a number is not finite; two that differ
/// by the square root of rounding where two solutions meet (the camera on
///          the "danger cylinder" through the points)
P3pSolutions p3p(std::span<const Vec3, 3> p_world, std::span<const Vec3, 3> rays_cam);

}  // namespace plumbline
