// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

namespace plumbline {

/// A motion of the camera before a plane: x_2 = R x_1 + t for points, n' x_1 = d > 0 on the plane, hence
/// px2 ~ K2 (R + (t / d) n') K1^-1 px1. A homography does not know d: the translation comes in units of the
/// distance of camera 1 from the plane.
struct PlaneMotion {
  Mat3 R;         ///< R_2_1
  Vec3 t_over_d;  ///< t_2_1 / d [distances of camera 1 from the plane]
  Vec3 normal_1;  ///< unit normal in camera 1, away from it: n' x_1 = d > 0 for the plane's points
};

/// The motions behind the homography of a plane, px2 ~ H px1, H of any scale and sign: singular value
/// decomposition of K2^-1 H K1 (Faugeras & Lustman 1988; Ma, Soatto, Kosecka & Sastry 2004, section 5.3.3).
/// \returns four, or two when the plane's normal is the direction of motion; each with its twin (-t/d, -n)
/// next
///          to it. visible_plane_motions() keeps those that a camera can have seen. Both cameras are taken to
///          lie on the same side of the plane. kDegenerate: H is singular, or a pure rotation to 1e-9, which
///          shows no plane (rotation_from_homography() reads it); kInvalidData for NaN
Result<std::vector<PlaneMotion>> plane_motions(const Mat3& H, const Mat3& K1, const Mat3& K2);

/// Those motions for which every seen point lies on the plane before both cameras: its ray K1^-1 px1 meets
/// the plane at n' x > 0, and R x + t has z > 0. Two remain for points of a bounded region, or one; none says
/// that the points do not belong to H. \param px1  pixels of points of the plane in image 1 [px]; none throws
/// std::invalid_argument
std::vector<PlaneMotion> visible_plane_motions(std::span<const PlaneMotion> motions, const Mat3& K1,
                                               std::span<const Vec2> px1);

}  // namespace plumbline
