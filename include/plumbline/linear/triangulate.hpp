// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <utility>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"

/// A point of space from its images in several views.
namespace plumbline {

/// Rays whose angle is below this many of its own standard deviations count as parallel. The inverse of the
/// distance, which is what an angle measures, is normally distributed to first order: rays that are parallel
/// in truth pass by chance 3 times in 100 000.
inline constexpr double kParallelSigmas = 4;
/// Rays at a smaller angle count as parallel whatever the noise [rad]: a pixel's ray is known to some 1e-13.
inline constexpr double kParallelRad = 1e-8;

/// A camera somewhere in the world.
struct PosedLens {
  Lens lens;
  SE3 T_cam_world;
};

/// A point and how well its views determine it.
struct Triangulated {
  Vec3 p_world;              ///< [unit of the world]
  Mat3 covariance;           ///< of p_world to first order, for pixels of the given sigma [unit squared]
  double ray_angle_rad = 0;  ///< between the two lines of sight nearest to a right angle, in (0, pi/2]
  double rms_px = 0;         ///< root mean square of the reprojection errors' lengths [px]
};

/// The point seen at px[i] by camera i, any lens: linear least squares on the rays, once with equal weights
/// and once more with the pixels that a metre at the point's distance is worth (Hartley & Sturm 1997,
/// "Iterative-LS"), which makes its error that of the best estimate to first order. refine_point() of
/// refine/point.hpp minimises the reprojection error itself.
/// \param cameras, px  n >= 2 views of one point; unequal numbers throw std::invalid_argument
/// \param sigma_px  standard deviation of each pixel coordinate, > 0 [px]
/// \returns kDegenerate "parallel": the angle between the rays is below kParallelSigmas of its standard
///          deviation under this noise, or below kParallelRad (also cameras in one place, a point on the line
///          through all centres); kDegenerate for fewer than two views; kInvalidData "behind": the lines meet
///          behind a camera, against its ray; kInvalidData for a pixel without a ray in its lens
Result<Triangulated> triangulate(std::span<const PosedLens> cameras, std::span<const Vec2> px,
                                 double sigma_px);

/// The same from camera matrices of finite cameras, any scale and sign of each. kInvalidData also for a P
/// whose left block is singular.
Result<Triangulated> triangulate(std::span<const Mat34> P_px_world, std::span<const Vec2> px,
                                 double sigma_px);

/// What triangulate() says of a point that somebody else found: its covariance, angle and error, or the same
/// refusals. kInvalidData also when a lens does not see it.
Result<Triangulated> triangulated_at(const Vec3& p_world, std::span<const PosedLens> cameras,
                                     std::span<const Vec2> px, double sigma_px);

/// The homogeneous point X, |X| = 1, X[3] >= 0, with P_i X ~ [px_i; 1]: n-view direct linear transformation
/// (Hartley & Zisserman 2004, section 12.2) with the two equations of a view scaled to unit length and the
/// columns to equal length. Any cameras, also projective ones: nothing is said about the sides of cameras,
/// and a point at infinity (X[3] = 0) is an answer.
/// \returns kDegenerate for fewer than two views, or when more than one X fits (singular value ratio below
///          1e-9: the views have one centre, or the point lies on the line through all of them); kInvalidData
///          for NaN
Result<Vec4> triangulate_linear(std::span<const Mat34> P_px_world, std::span<const Vec2> px);

/// A line of sight: origin + s direction, s > 0.
struct WorldRay {
  Vec3 origin;
  Vec3 direction;  ///< any length
};

/// The point with the least sum of squared distances from n >= 2 rays: for two, the midpoint of their common
/// perpendicular. No lens and no noise is asked for, every ray weighs the same.
/// \returns kDegenerate "parallel" for angles below kParallelRad, and for fewer than two rays; kInvalidData
///          "behind" when the point lies before the origin of a ray; kInvalidData for NaN or a direction of
///          length 0
Result<Vec3> triangulate_midpoint(std::span<const WorldRay> rays);

/// The two pixels nearest to px1, px2 (least sum of squared distances) that fulfil [px2; 1]' F [px1; 1] = 0
/// exactly: the polynomial of degree 6 of Hartley & Sturm, "Triangulation" (1997), Hartley & Zisserman 2004,
/// algorithm 12.1. The maximum-likelihood correction under equal, independent, normal noise.
/// \param F  fundamental matrix, any scale, rank 2
/// \returns kInvalidData for a NaN or F = 0; kDegenerate when a pixel is at an epipole, whose epipolar line
/// is
///          every line
Result<std::pair<Vec2, Vec2>> correct_matches(const Mat3& F, const Vec2& px1, const Vec2& px2);

/// The maximum-likelihood point of two pinhole or projective views: correct_matches() with the F of the two
/// cameras, then triangulate_linear(), whose two rays now meet. Same answer and failures as those two.
Result<Vec4> triangulate_optimal(const Mat34& P1, const Mat34& P2, const Vec2& px1, const Vec2& px2);

}  // namespace plumbline
