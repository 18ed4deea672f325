// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <span>
#include <vector>

#include "linear/lifted.hpp"
#include "plumbline/core/result.hpp"

/// Pairs of pixels in normalised coordinates, each image by its own similarity. Private to the module.
namespace plumbline::detail {

struct PixelPairs {
  Normaliser normaliser_1, normaliser_2;
  Mat3 T1, T2;               ///< [normalised; 1] = T [px; 1]
  std::vector<Lifted> a, b;  ///< normalised; pixels are still the unit of their Jacobians

  PixelPairs(std::span<const Vec2> px1, std::span<const Vec2> px2);

  Mat3 denormalised(const Mat3& F) const;  ///< of pixels, |F| = 1
  Mat3 normalised(const Mat3& F) const;
  Mat3 denormalised_homography(const Mat3& H) const;  ///< of pixels, |H| = 1 and the sign of H
  /// From each normalised image to the coordinates of image 1, which both share.
  Mat3 T_common_1() const { return Mat3::Identity(); }
  Mat3 T_common_2() const { return T1 * T2.inverse(); }
  /// What rounding leaves of a Sampson distance, with room.
  double rounding_px() const;
};

/// kInvalidData for NaN, kDegenerate for pixels that coincide.
std::optional<Error> refuse_pixels(std::span<const Vec2> px1, std::span<const Vec2> px2, const char* where);

/// F of lifted pairs by the 8-point algorithm, its rank not yet enforced.
struct EightPoint {
  Mat3 F;              ///< |F| = 1
  double determinacy;  ///< the last but one singular value over the largest; up to three times below it
  double residual;     ///< the last one over the same
  /// A plane or a turn makes the last three singular values noise. With eight rows more than that leaves of
  /// the equations, two noise values differ by a factor of 10 less than once in 1e5; where they do, the null
  /// vector stands out and there is nothing to compare.
  bool is_clear(std::size_t n) const { return n >= 16 && determinacy > 1e-6 && determinacy >= 10 * residual; }
};
EightPoint eight_point(std::span<const Lifted> a, std::span<const Lifted> b, std::span<const int> of);
EightPoint eight_point(std::span<const Lifted> a, std::span<const Lifted> b);

/// The nearest matrix of rank 2.
Mat3 with_rank_2(const Mat3& F);

}  // namespace plumbline::detail
