// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "linear/lifted.hpp"
#include "plumbline/core/result.hpp"
#include "plumbline/linear/ransac.hpp"
#include "plumbline/linear/two_view_degeneracy.hpp"

/// The comparison of epipolar geometry with a homography on lifted pixels of any kind. Private to the module.
namespace plumbline::detail {

/// The value that a quotient of two estimates of one variance, of d1 and d2 degrees of freedom, stays below
/// in 999 cases of 1000: Wilson & Hilferty's normal approximation of its cube root (Paulson 1942), within 10
/// % for d2 >= 4.
double variance_ratio_limit(double d1, double d2);

/// The smallest k for which k or more of n pairs agree with a model by chance, each with probability p, in
/// less than one of 100 cases, when the best of n_tried models is taken (Moisan & Stival 2004).
int needed_beyond_chance(int n, double p, double n_tried);

/// The probability that a pair unrelated to F has a Sampson distance of at most `tolerance_px`: the band of
/// that half width times sqrt(2) about the line, over the side of a square that holds the pixels.
double chance_of_agreement(double tolerance_px, std::span<const Vec2> px);

/// The noise of a coordinate, as an estimate of its variance [px^2].
struct Noise {
  double variance;
  double dof;
  double sigma_px() const { return std::sqrt(variance); }
  /// The distance from a homography that noise exceeds in one of `n` pairs once in 1000 scenes [px]: of a
  /// squared normal vector of the plane, widened by what the estimate may be wrong.
  double tolerance_px(std::size_t n) const;
};
/// From n Sampson distances of F, which took `model_dof` from them, with the prior of
/// compare_with_homography(). `rounding_px` is what rounding leaves without any noise.
Noise noise_of(const Mat3& F, std::span<const Lifted> a, std::span<const Lifted> b, int model_dof,
               double rounding_px);

/// H with b ~ H a from exactly four pairs, its sign that of the first; nullopt when they do not determine it.
std::optional<Mat3> four_point_homography(std::span<const Lifted> a, std::span<const Lifted> b,
                                          std::span<const int> sample);

/// Least squares through the pairs `of`, without refusals but for a lack of them.
std::optional<Mat3> fit_homography(std::span<const Lifted> a, std::span<const Lifted> b,
                                   std::span<const int> of);

/// The homography that most pairs agree with within tolerance_px, from at most `most` samples.
std::optional<Found<Mat3>> dominant_homography(std::span<const Lifted> a, std::span<const Lifted> b,
                                               double tolerance_px, int most, std::uint64_t seed);

/// Whether the pairs `on` a homography move along their epipolar lines by no more than noise: the F-test of
/// compare_with_homography(). `extra_dof` is SSE_H's degrees of freedom less SSE_F's.
struct VarianceTest {
  double ratio = 0, needed = 0;
  bool is_degenerate() const { return ratio <= needed; }
};
VarianceTest variance_test(const Mat3& F, const Mat3& H, std::span<const Lifted> a, std::span<const Lifted> b,
                           std::span<const int> on, double extra_dof, const Noise& noise);

/// Whether the homography H of the pairs `on` it is that of a camera that turned. T_common_i take each lifted
/// image to coordinates that both share. The noise is that of the pairs' distances from H.
bool is_turn(const Mat3& H, std::span<const Lifted> a, std::span<const Lifted> b, std::span<const int> on,
             const Mat3& T_common_1, const Mat3& T_common_2);

/// The same of unit rays, where a turn is a rotation and nothing else: an F-test of the five parameters that
/// a homography has more.
bool is_ray_turn(const Mat3& H, std::span<const Lifted> a, std::span<const Lifted> b, std::span<const int> on,
                 double rounding_px);

/// compare_with_homography() on lifted pixels. is_turn(H, on) names the degeneracy.
using IsTurn = std::function<bool(const Mat3&, std::span<const int>)>;
TwoViewComparison compare(const Mat3& F, std::span<const Lifted> a, std::span<const Lifted> b,
                          double rounding_px, const IsTurn& is_turn);

/// Pairs, by their index, that a homography explains, and the others.
struct Plane {
  Mat3 H;
  std::vector<int> on, off;
};
Plane split_by_homography(const Mat3& H, std::span<const Lifted> a, std::span<const Lifted> b,
                          double tolerance_px);

/// The plane that holds at least half of the inliers of F, over all pairs.
std::optional<Plane> dominant_plane(const Found<Mat3>& found, std::span<const Lifted> a,
                                    std::span<const Lifted> b, const Noise& noise, std::uint64_t seed);

/// Whether the inliers of a search are too few off a plane, for geometry or for chance, and those on it move
/// by no more than noise: kPlanarScene then, for the caller to name. `extra_dof` as in variance_test() less
/// the number of pairs on the plane.
TwoViewComparison judge(const Found<Mat3>& found, const Plane& plane, std::span<const Lifted> a,
                        std::span<const Lifted> b, std::span<const Vec2> px2, const Noise& noise,
                        double extra_dof);

/// noise_of() among the inliers.
Noise noise_among(const Found<Mat3>& found, std::span<const Lifted> a, std::span<const Lifted> b,
                  int model_dof, double rounding_px);

/// Why the inliers of a search are no more than chance gives, when so: of an answer that `model_dof` pairs
/// determine, the best of n_tried.
std::optional<Error> refuse_chance(const Found<Mat3>& found, std::span<const Lifted> a,
                                   std::span<const Lifted> b, std::span<const Vec2> px2, int model_dof,
                                   double n_tried, const char* what, const char* where);

std::vector<Lifted> subset(std::span<const Lifted> all, std::span<const int> of);

/// Below this share of the extent of the pixels residuals are rounding: coordinates of 1e4 px have 1e-12 of
/// it, and the solvers lose three to five digits.
inline constexpr double kRoundingShare = 1e-9;

}  // namespace plumbline::detail
