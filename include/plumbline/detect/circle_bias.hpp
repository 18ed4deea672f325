// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>

#include "plumbline/core/types.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"

namespace plumbline {

/// What a circle of a board looks like through a lens.
struct DiscImage {
  Vec2 centroid_px = Vec2::Zero();  ///< of the area inside its outline: what a detector of blobs measures
  Vec2 centre_px = Vec2::Zero();    ///< projection of its centre: what a calibration wants
  double area_px2 = 0;
  /// What is to be taken from a measured centroid. Third order in the circle's size; perspective alone makes
  /// it (Heikkila, "Geometric camera calibration using circular control points", PAMI 2000, section 2.2), and
  /// a lens that bends lines adds to it.
  Vec2 bias_px() const { return centroid_px - centre_px; }
};

/// The image of the circle of `diameter_m` about `centre_board`, parallel to the board's plane z = 0:
/// integrals along the outline (Green's theorem), whose points and tangents the lens gives, over 48 equal
/// steps of the angle, which leaves less than 1e-6 px. nullopt where the lens does not show the whole
/// outline. \pre diameter_m > 0
std::optional<DiscImage> disc_image(const Lens& lens, const SE3& T_cam_board, const Vec3& centre_board,
                                    double diameter_m);

}  // namespace plumbline
