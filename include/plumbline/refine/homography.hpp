// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

namespace plumbline {

/// Which of the two sets of points carries errors.
enum class HomographyNoise {
  kSecond,  ///< b only, as for a printed board (a) and its image: minimises  sum |b - H a|^2
  kBoth     ///< a and b alike, as for two photographs: minimises  sum |a - a^|^2 + |b - H a^|^2  over H and
            ///< every a^ (the Gold Standard of Hartley & Zisserman 2004, algorithm 4.3)
};

/// A homography that minimises the geometric error, with its uncertainty.
struct RefinedHomography {
  Mat3 H;  ///< |H| = 1 (Frobenius), w > 0 for the first point
  /// 9x9, of H's entries row by row at |H| = 1: rank 8, its null vector is H itself. For errors of sigma_px
  /// in each coordinate that carries errors, to first order.
  Eigen::Matrix<double, 9, 9> covariance;
  /// Root mean square over the correspondences of |b - H a|, or of sqrt(|a - a^|^2 + |b - H a^|^2).
  double rms_px;
  int iterations;
};

/// Refines the 8 degrees of freedom of H from a start such as homography(). Levenberg-Marquardt on the unit
/// sphere of H in normalised coordinates; with kBoth the points a^ are eliminated: solved for within each
/// evaluation, and taken out of the normal equations exactly.
/// \param start_H  of any scale and sign; each point stays on the side of the horizon that it is on in the
/// start \param a, b  n >= 4 points [px]; with kSecond the unit of a is free. Fewer, unequal numbers or
///        sigma_px <= 0 throw std::invalid_argument
/// \returns kDegenerate when the points do not determine H (normal equations of unit diagonal with an
/// eigenvalue
///          below 1e-13 of the largest), kNotConverged, or kInvalidData for NaN or a start that puts a point
///          on its horizon
Result<RefinedHomography> refine_homography(const Mat3& start_H, std::span<const Vec2> a,
                                            std::span<const Vec2> b, double sigma_px, HomographyNoise noise);

}  // namespace plumbline
