// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>

#include "plumbline/rig/rig.hpp"

namespace plumbline {

/// Pixel of p_cam, and the unit ray of px in the camera frame, as project() and unproject() of its lens give
/// them; nullopt also beyond the camera's validity. What maps or compares images asks these, not the lens.
std::optional<Vec2> project(const Camera& camera, const Vec3& p_cam, Mat23* J_px_p = nullptr);
std::optional<Vec3> unproject(const Camera& camera, const Vec2& px);

/// The angle from the optical axis at which the domain of a lens ends, the least over all directions [rad]:
/// at the latest pi / 2 for a lens that looks forward only, pi for the others. 0 when not even the axis
/// projects.
double domain_angle_rad(const Lens& lens);

/// A validity of that angle for this lens, no wider than its domain, with its radius in the image. \pre
/// angle_rad > 0
Validity validity_of(const Lens& lens, double angle_rad);

/// Share of a 40 x 30 grid over the image, its border included, to which a ray of the lens (of the camera,
/// with its validity) leads.
double domain_fraction(const Camera& camera);

/// Whether the radial map of the lens turns back inside the picture, or runs off to infinity there: a pixel
/// of the border that no ray of the lens reaches, or one beside a pole of a rational lens (where the radius
/// grows with more than the fourth power of the distance from the axis on the plane z = 1), although the lens
/// does not show all that one of its kind can (90 degrees for a lens that looks forward only, all directions
/// for a fisheye). The camera's validity is not looked at.
bool folds_in_image(const Camera& camera);

/// Where a lens that folds_in_image() does so: where it turns back, or, beside a pole, where the radius
/// begins to grow with more than the fourth power (to a thousandth of the way to the pole).
struct Fold {
  Validity end;
  bool is_pole = false;
};
Fold fold_of(const Lens& lens);

}  // namespace plumbline
