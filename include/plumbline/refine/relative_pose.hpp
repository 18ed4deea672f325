// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"

namespace plumbline {

/// A refined relative pose and what noise leaves uncertain of it.
struct RefinedRelativePose {
  SE3 T_2_1;          ///< |t| = 1
  Mat6 covariance;    ///< of the box_plus step [dw (rad) | dt (baselines)]; rank 5: dt is across t
  double rms_px = 0;  ///< root mean square Sampson distance
  int iterations = 0;
};

/// T_2_1 with |t| = 1 that minimises the sum of the squared Sampson distances in pixels, for any two lenses:
/// rays are lifted to first order in their pixels' noise. Five parameters: three of the rotation, two of the
/// direction of the baseline; Levenberg-Marquardt. As close to the gold standard as refine_fundamental() is.
/// A pair within some 20 sigma of an epipole bends the constraint within its noise: the covariance, of first
/// order, is too small then. \param start_T_2_1  near the answer, any |t| > 0: essential_ransac() \param px1,
/// px2  n >= 6 pairs without outliers, inside the domains of their lenses; fewer, or unequal
///        numbers, throw std::invalid_argument
/// \param sigma_px  noise of each coordinate in both images [px], > 0; scales the covariance only
/// \returns kDegenerate when the pairs leave a parameter undetermined; kInvalidData for NaN, a pixel outside
///          its lens' domain (the message names the pair) and a start without a baseline; kNotConverged
Result<RefinedRelativePose> refine_relative_pose(const SE3& start_T_2_1, const Lens& lens_1,
                                                 const Lens& lens_2, std::span<const Vec2> px1,
                                                 std::span<const Vec2> px2, double sigma_px);

}  // namespace plumbline
