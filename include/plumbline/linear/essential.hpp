// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <span>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"
#include "plumbline/linear/epipolar.hpp"
#include "plumbline/linear/ransac.hpp"

/// Two views of calibrated lenses. Everything is said in unit rays, so that a fisheye's rays at and beyond 90
/// degrees count like any other: ray_2' E ray_1 = 0 with E = [t]_x R of T_2_1 = {R, t}, |E| = sqrt(2), |t| =
/// 1 (the baseline is the unit of length).
namespace plumbline {

/// The essential matrices of exactly five pairs of unit rays, up to ten, by elimination to a polynomial of
/// degree ten (Nister 2004), each polished on the ten cubic equations. A plane is no obstacle, but has two
/// answers. \param rays_1, rays_2  five unit rays; other numbers throw std::invalid_argument \returns
/// kDegenerate when two pairs are the same, and by name when a rotation maps the rays onto one
///          another to 1e-9: the camera only turned; kInvalidData for NaN
Result<std::vector<Mat3>> essential_5point(std::span<const Vec3> rays_1, std::span<const Vec3> rays_2);

/// Essential matrix by the 8-point algorithm (Longuet-Higgins 1981; Hartley & Zisserman 2004, 9.6) on
/// directions widened to a well-conditioned spread, its two singular values made equal.
/// \param rays_1, rays_2  n >= 8 pairs without outliers; fewer, or unequal numbers, throw
///        std::invalid_argument
/// \returns kDegenerate, by name, for a planar scene (five pairs are better there: essential_ransac()) and a
///          camera that only turned, with and without noise, taking 1e-3 rad for one pixel
///          (compare_with_homography()); kInvalidData for NaN
Result<Mat3> essential_8point(std::span<const Vec3> rays_1, std::span<const Vec3> rays_2);

/// The four T_2_1 = {R, +-t} of E, |t| = 1 (H&Z result 9.19): R_a with t and -t, then R_b with both; R_b is
/// R_a turned by 180 degrees about the baseline. Any scale and sign of E, singular values made equal.
std::array<SE3, 4> decompose_essential(const Mat3& E);

struct RelativePose {
  SE3 T_2_1;                   ///< |t| = 1
  Mat3 E;                      ///< [t]_x R, |E| = sqrt(2)
  std::vector<bool> in_front;  ///< per pair: its rays meet ahead of both cameras, along the rays, any z
  int n_in_front = 0;
};

/// The one of the four whose points lie ahead of both cameras along their rays (cheirality). First the
/// rotation, by the side of the baseline on which both rays of a pair leave it, then the sign of the baseline
/// by the parallax, each pair weighted by how sure it can be: a far point says nothing of the sign.
/// \param rays_1, rays_2  n >= 1 pairs; none, or unequal numbers, throw std::invalid_argument
/// \returns kDegenerate when the weight of the better answer is below twice that of the worse
Result<RelativePose> relative_pose_from_essential(const Mat3& E, std::span<const Vec3> rays_1,
                                                  std::span<const Vec3> rays_2);

/// The relative pose that most pairs agree with, by seeded samples of five and Gauss-Newton refits. A pair is
/// an inlier when its Sampson distance in PIXELS, through the derivatives of both lenses, is at most
/// inlier_px; a pixel outside its lens' domain is an outlier.
/// \param px1, px2  n >= 6 pairs; fewer, or unequal numbers, throw std::invalid_argument
/// \returns kDegenerate by name: "the camera only turned", when a rotation explains the inliers, or all but
///          what chance adds; "the scene is a plane" when a plane's two motions both explain them, are more
///          than 2 degrees apart and both see the points ahead (one motion is returned when the other is
///          ruled out); no more inliers than chance gives; fewer than six pairs inside both domains.
///          kInvalidData for NaN
Result<Found<RelativePose>> essential_ransac(const Lens& lens_1, const Lens& lens_2,
                                             std::span<const Vec2> px1, std::span<const Vec2> px2,
                                             const RansacOptions& options);

}  // namespace plumbline
