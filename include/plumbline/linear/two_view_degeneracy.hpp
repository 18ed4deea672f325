// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <string>

#include "plumbline/core/types.hpp"

namespace plumbline {

/// Why a homography explains two views as well as their epipolar geometry does, so that the latter is not
/// determined.
enum class TwoViewDegeneracy {
  kNone,
  kPlanarScene,   ///< all points, or all but too few, lie in a plane
  kPureRotation,  ///< the camera turned, or stood still, and saw no parallax
};

/// "none", "the scene is a plane", "the camera only turned".
const char* to_string(TwoViewDegeneracy kind);

/// The comparison of a fundamental matrix F with the homography H that most of its pairs agree with. Torr,
/// Fitzgibbon & Zisserman (1999, "The problem of degeneracy in structure and motion recovery") compare by an
/// information criterion; here it is a test of variances, whose threshold is a probability.
struct TwoViewComparison {
  TwoViewDegeneracy kind = TwoViewDegeneracy::kNone;
  Mat3 H = Mat3::Zero();  ///< px2 ~ H px1, |H| = 1; zero when no homography fits four pairs
  int n = 0;              ///< pairs compared
  int n_off = 0;          ///< of these, pairs that H does not explain
  int n_off_needed = 0;   ///< for F to be determined by them
  /// Mean squared parallax of the others, per degree of freedom, over the variance of F's residuals, and what
  /// noise alone would stay below in 999 cases of 1000 (at least 2).
  double ratio = 0, ratio_needed = 0;
  double noise_px = 0;  ///< the noise that F leaves in each coordinate

  /// The sentence that a user reads: what was seen, the numbers, what to do. Empty for kNone.
  std::string text() const;
};

/// Compares F with a homography on the pairs given, which should be free of outliers.
///
/// The noise of one coordinate is taken from F's Sampson distances: s^2 = (SSE_F + 3 px^2) / (n - 7 + 3), as
/// if three residuals of 1 px had been seen before, because the one residual of eight pairs says little; data
/// whose residuals are rounding count as free of noise. A homography is searched for by random samples of
/// four (seed 0) and fitted to all that agree with it within sqrt(2 ln(1000 n)) s, which noise exceeds in one
/// of 1000 scenes. When fewer than two pairs remain off it, and the others move along their epipolar lines by
/// no more than noise would let them (F-test of SSE_H - SSE_F on as many degrees of freedom as there are
/// pairs), the views are degenerate.
///
/// A turn is told from a plane by H alone: H = K R K^-1 with one K has eigenvalues 1 and e^(+-i angle), that
/// is, with det H = 1, trace H = trace H^-1 (within four of its standard deviations), and is no farther from
/// the identity than that angle makes it behind a lens of at least 25 degrees; a sideways step before a
/// frontal plane has such eigenvalues and angle 0. Two different K are not told from a plane.
///
/// \param px1, px2  n >= 8 pixels [px]; fewer, or unequal numbers, throw std::invalid_argument
TwoViewComparison compare_with_homography(const Mat3& F, std::span<const Vec2> px1,
                                          std::span<const Vec2> px2);

}  // namespace plumbline
