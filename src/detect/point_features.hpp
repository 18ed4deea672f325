// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <vector>

#include "detect/saddle_fit.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"
#include "plumbline/target/target.hpp"

/// What the image shows at each point of a target, and where a lens that is known puts it.
namespace plumbline::detail {

/// The print around one point.
struct PointFeature {
  Vec3 u, v;  ///< one board unit (square, tag, spacing) along both axes, target frame [m]
  /// Saddles: low, high and across of the window, in board units. Its J and curvature are the view's.
  SaddleWindow window;
  /// Of a saddle's contrast: -1 or +1 by the board's pattern, 0 for a disc.
  int sign = 0;
  bool is_sign_absolute = false;  ///< else boards exist that differ by the sign of all corners
  double radius = 0;              ///< of a disc [board units]
  double gap = 0;                 ///< between a disc's outline and that of its neighbour [board units]
  Vec3 towards_viewer;            ///< unit normal of the printed side, target frame
};

/// One for each point; empty for free points. `disc_diameter_m` of circle grids: 0 for the target's own.
std::vector<PointFeature> point_features(const Target& target, double disc_diameter_m = 0);

/// Diameter of a circle grid's discs as it is printed [m].
double printed_diameter_m(const Circles& board);

/// A point in an image as a pose and a lens foretell it.
struct PointPlace {
  Vec2 px;
  Mat2 J;          ///< d px / d board units
  Vec2 curvature;  ///< of the board lines through it, as SaddleWindow wants it [1/px]
};

/// nullopt: the lens does not show the point, or it is seen from behind or under less than 5 degrees.
std::optional<PointPlace> place_of(const Lens& lens, const SE3& T_cam_target, const Vec3& p_target,
                                   const PointFeature& feature);

}  // namespace plumbline::detail
