// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <optional>
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/linear/ransac.hpp"

namespace plumbline {

/// Homography by normalised DLT (Hartley & Zisserman 2004, alg. 4.2):  w [b; 1] = H [a; 1],
/// |H| = 1, w > 0 for the first point.
/// \param a, b  n >= 4 points of each plane, any unit; fewer, or unequal numbers, throw
///        std::invalid_argument
/// \returns kDegenerate when the null space has more than one dimension: all points, or all but one,
///          on a line in either plane (also with noise), or fewer than four places;
///          kInvalidData for NaN
Result<Mat3> homography(std::span<const Vec2> a, std::span<const Vec2> b);

/// The homography through four points, w [b; 1] = H [a; 1], |H| = 1, in closed form and without allocation:
/// the product of the two maps from a projective basis (Hartley & Zisserman 2004, section 2.2). nullopt when
/// three of the points lie on a line in either plane, or no H has w > 0 for all four: the image of a plane
/// before the camera turns no triangle of it over alone.
std::optional<Mat3> homography_from_four(const std::array<Vec2, 4>& a, const std::array<Vec2, 4>& b);

/// Homography that most correspondences agree on, whatever the others are: samples of four, refit by
/// homography() to all inliers.
/// Inlier: w > 0 and transfer error  |b - H a| <= options.inlier_px  in the SECOND plane, whose unit is the
/// pixel; the unit of a is free. |H| = 1, w > 0 for the inliers. \param a, b  n >= 4 points; fewer, or
/// unequal numbers, throw std::invalid_argument, and so do options out of
///        range
/// \returns kDegenerate when no five points agree (n > 4), or the inliers do not determine H, as
/// homography();
///          kInvalidData for NaN
Result<Found<Mat3>> homography_ransac(std::span<const Vec2> a, std::span<const Vec2> b,
                                      const RansacOptions& options);

/// The same onto rays instead of pixels:  ray ~ H [a; 1] with a POSITIVE factor (for most points,
/// should the points contradict one another), |H| = 1, for lenses that see behind themselves.
/// Minimises  sum |ray x H a|^2, in which every ray weighs the same.
/// \param rays_cam  unit directions in the camera frame, any z
/// \returns as homography(); kDegenerate also for a board seen edge-on (all rays in one plane)
Result<Mat3> homography_to_rays(std::span<const Vec2> a, std::span<const Vec3> rays_cam);

}  // namespace plumbline
