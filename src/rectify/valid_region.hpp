// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "plumbline/rig/rig.hpp"

/// What a camera shows in the plane z = 1 of a virtual camera ("the plane"): the ground of alpha scaling.
namespace plumbline::detail {

/// A camera looked at from a rotated frame: p_new = R_new_cam * p_cam.
struct RotatedView {
  const Camera* camera = nullptr;
  Mat3 R_new_cam = Mat3::Identity();

  /// Whether the direction (q, 1) falls on the image, where bilinear interpolation has all four neighbours,
  /// and within kMaxHalfAngle_deg.
  bool sees(const Vec2& q) const;
};

/// The border of what `view` sees around `anchor`, as `n` points: along each of n rays from the anchor the
/// last point of the plane before the view ends. The region between is valid whatever the lens. Empty when
/// the anchor is not seen.
std::vector<Vec2> inner_outline(const RotatedView& view, const Vec2& anchor, int n = 720);

/// The pixels of the image's border in the plane, drawn in to kMaxHalfAngle_deg where they lie beyond; pixels
/// that no ray of the lens reaches are left out.
std::vector<Vec2> outer_outline(const RotatedView& view);

/// A frame over the plane: px = f (q - anchor) + anchor_px, for any f > 0.
struct Frame {
  Vec2 anchor = Vec2::Zero();
  Vec2 anchor_px = Vec2::Zero();
  ImageSize size;

  /// The largest f at which q is still inside the frame (infinite at the anchor).
  double focal_reaching(const Vec2& q) const;
};

/// The smallest focal length [px] that shows only points inside all outlines.
double focal_of_valid(const Frame& frame, const std::vector<std::vector<Vec2>>& inner);

/// The largest focal length [px] that shows all points of all outlines.
double focal_of_all(const Frame& frame, const std::vector<std::vector<Vec2>>& outer);

}  // namespace plumbline::detail
