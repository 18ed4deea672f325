// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/linear/epipolar.hpp"
#include "plumbline/linear/ransac.hpp"
#include "plumbline/linear/two_view_degeneracy.hpp"

namespace plumbline {

/// Fundamental matrix by the normalised 8-point algorithm (Hartley 1997; Hartley & Zisserman 2004, alg.
/// 11.1): [px2; 1]' F [px1; 1] = 0, rank 2, |F| = 1. The pixels are those of a pinhole (straight lines are
/// straight). \param px1, px2  n >= 8 pairs without outliers [px]; fewer, or unequal numbers, throw
///        std::invalid_argument
/// \returns kDegenerate for a planar scene and for a camera that only turned, by name, with and without noise
///          (compare_with_homography()), and for pairs that more than one F fits for another reason; the
///          message has the numbers. kInvalidData for NaN
Result<Mat3> fundamental_8point(std::span<const Vec2> px1, std::span<const Vec2> px2);

/// The one or three F of rank 2 through exactly seven pairs (H&Z 11.1.2), |F| = 1. Without an eighth pair
/// nothing tells which is right, nor noise from structure: a planar scene is refused only when the pairs are
/// free of noise. \param px1, px2  seven pairs [px]; other numbers throw std::invalid_argument \returns
/// kDegenerate when the seven equations are dependent to 1e-9: a planar scene, a camera that
///          only turned, or pairs that coincide; kInvalidData for NaN
Result<std::vector<Mat3>> fundamental_7point(std::span<const Vec2> px1, std::span<const Vec2> px2);

/// F that most pairs agree with: seeded samples of seven, refits by the 8-point algorithm. A pair is an
/// inlier when its Sampson distance is at most inlier_px. When more than half of the inliers lie on one
/// plane, F is searched for again as that plane's homography and two pairs off it (plane and parallax;
/// DEGENSAC, Chum, Werner & Matas 2005), because samples of seven then seldom hold enough of the rest.
/// \param px1, px2  n >= 8 pairs [px]; fewer, or unequal numbers, throw std::invalid_argument
/// \returns kDegenerate for a planar scene and for a camera that only turned, by name: when no more pairs are
///          off the homography than chance lets agree with the best of all F that hold the plane; and when no
///          F has more inliers than chance gives. kInvalidData for NaN
Result<Found<Mat3>> fundamental_ransac(std::span<const Vec2> px1, std::span<const Vec2> px2,
                                       const RansacOptions& options);

}  // namespace plumbline
