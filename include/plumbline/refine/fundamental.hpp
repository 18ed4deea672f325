// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

namespace plumbline {

/// A refined fundamental matrix and what noise leaves uncertain of it.
struct RefinedFundamental {
  Mat3 F;  ///< rank 2, |F| = 1, the sign of the start
  /// Of the entries of F, row after row; rank 7, of first order: entries of an F whose epipole is uncertain
  /// by its own distance are bent functions of the noise, and only the part along the surface is told.
  Eigen::Matrix<double, 9, 9> covariance;
  double rms_px = 0;  ///< root mean square Sampson distance
  int iterations = 0;
};

/// F that minimises the sum of the squared Sampson distances, over the seven parameters of F = U diag(cos p,
/// sin p, 0) V' with rotations U and V (orthonormal representation: Bartoli & Sturm 2004), by
/// Levenberg-Marquardt. The Sampson distance is that to the nearest pair that fulfils F to first order in
/// (noise over the distance to the epipoles); the answers lie within a tenth of the noise's error of those of
/// the gold standard (Hartley & Zisserman 2004, alg. 11.3), which a test minimises beside it, and have its
/// errors where pairs lie near an epipole too.
/// \param start  F near the answer, any scale: fundamental_8point() or fundamental_ransac()
/// \param px1, px2  n >= 8 pairs without outliers; fewer, or unequal numbers, throw std::invalid_argument
/// \param sigma_px  noise of each coordinate in both images [px], > 0; scales the covariance only
/// \returns kDegenerate when the pairs leave a parameter undetermined (a planar scene, a camera that only
///          turned; ask compare_with_homography() where in doubt); kInvalidData for NaN; kNotConverged
Result<RefinedFundamental> refine_fundamental(const Mat3& start, std::span<const Vec2> px1,
                                              std::span<const Vec2> px2, double sigma_px);

}  // namespace plumbline
