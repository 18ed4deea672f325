// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

/// What the estimators by direct linear transformation share. Private to the module.
namespace plumbline::detail {

/// Below this ratio of extents points count as lying on a line or in a plane.
inline constexpr double kFlat = 1e-6;
/// Below this ratio to the largest, a singular value of a normalised system counts as zero.
inline constexpr double kRankTolerance = 1e-9;

/// Principal extents of points, columns of a d x n matrix.
struct Spread {
  VecX centroid;    ///< d
  VecX sigma;       ///< RMS extent along each principal axis, descending
  MatX axes;        ///< d x d, principal axes as columns, in the order of sigma
  double leverage;  ///< the largest hat value: 1 when one point alone keeps the others from being flat
  /// sigma.last / sigma.first, 0 for points that coincide.
  double flatness() const;
};
Spread spread(const MatX& points);

/// The similarity that moves the points' centroid to 0 and their RMS distance from it to sqrt(d), as a
/// (d+1) x (d+1) matrix (Hartley 1997).
MatX normalising_similarity(const Spread& s);

/// T * [points; 1], a (d+1) x n matrix.
MatX to_homogeneous(const MatX& T, const MatX& points);

MatX as_matrix(std::span<const Vec2> points);
MatX as_matrix(std::span<const Vec3> points);

/// Rays prepared for a DLT: T turns their mean to z and then widens a narrow bundle, so that the transverse
/// parts are as large as the axial one. The rows of E vanish when  H a  is parallel to T * ray, whatever its
/// z, and |E T v| is the distance of v from the ray's line in the camera frame (up to one factor for all
/// rays), so that every ray weighs the same. T is linear and has det T > 0: a ray behind the camera keeps its
/// direction.
struct PreparedRays {
  Mat3 T;
  std::vector<Mat23> E;
  double flatness;  ///< smallest over largest RMS extent of the widened rays; 0 when all lie in a plane
                    ///< through 0
};
PreparedRays prepare_rays(std::span<const Vec3> rays);

/// The 3 x k matrix H of unit norm that minimises  sum |E_i H a_i|^2, a_i the columns of a (k x n), k = 3
/// or 4.
struct DltSolution {
  MatX H;
  /// The last but one singular value over the largest, zero when more than one H fits; above 1e-4 up to a
  /// factor 4 below.
  double determinacy;
};
DltSolution solve_dlt(const MatX& a, std::span<const Mat23> E);

}  // namespace plumbline::detail
