// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>

#include "plumbline/core/types.hpp"
#include "plumbline/geometry/se3.hpp"

/// Pinhole image formation with camera matrices, w [px; 1] = P [p_world; 1]. Lenses with distortion have
/// lens/lens.hpp.
namespace plumbline {

/// P = K [R | t] (Hartley & Zisserman 2004, eq. 6.8).
Mat34 compose_camera_matrix(const Mat3& K, const SE3& T_cam_world);

/// Where a camera matrix images a point, and how far before (> 0) or behind (< 0) the camera it lies.
struct ImagePoint {
  Vec2 px;
  double depth;  ///< along the optical axis [unit of the world]
};

/// The image of p_world, also of a point behind the camera: a camera matrix images both sides, and the sign
/// of the depth tells them apart. nullopt for a point of the principal plane (w below the rounding of its own
/// terms), whose image is at infinity.
/// \pre P is finite and its left 3x3 block is not singular; throws std::invalid_argument otherwise.
std::optional<ImagePoint> image_of(const Mat34& P, const Vec3& p_world);

/// Depth of a point along the optical axis [unit of the world], whatever the scale and sign of P and of the
/// homogeneous point: sign(det M) w / (p_world_h[3] |m3|), Hartley & Zisserman 2004, eq. 6.15. Infinite for a
/// point at infinity, with the sign of the side. \pre as image_of
double signed_depth(const Mat34& P, const Vec4& p_world_h);

}  // namespace plumbline
