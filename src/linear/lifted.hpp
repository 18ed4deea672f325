// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "plumbline/core/types.hpp"
#include "plumbline/lens/lens.hpp"

/// Pixels of any lens as 3-vectors that know how a pixel moves them, so that one formula measures fundamental
/// and essential matrices, homographies of pixels and of rays, in pixels. Private to the module.
namespace plumbline::detail {

using Mat32 = Eigen::Matrix<double, 3, 2>;

/// A pixel lifted to a direction in space: (x, y, 1) of a normalised pixel, or the unit ray of a lens.
struct Lifted {
  Vec3 v;
  Mat32 J_v_px;
  Mat23 J_px_v;  ///< along J_v_px only: J_px_v * J_v_px = I and J_px_v * v = 0
  Vec3 measure;  ///< measure . v = 1; a multiple k v has measure k
};

/// scale * (px - centre) for both images alike or apart; the similarity is T.
struct Normaliser {
  double scale = 1;
  Vec2 centre = Vec2::Zero();
  Mat3 T() const;
};

/// RMS distance sqrt(2) from the centroid 0 (Hartley 1997); scale 1 for points that coincide.
Normaliser normaliser_of(std::span<const Vec2> px);

Lifted lift(const Normaliser& normaliser, const Vec2& px);
std::vector<Lifted> lift(const Normaliser& normaliser, std::span<const Vec2> px);

/// Of a unit ray whose "pixels" are radians across it.
Lifted lift_ray(const Vec3& ray);

/// Of a pixel of a lens: nullopt outside its domain, or where the projection has no derivative of full rank.
std::optional<Lifted> lift(const Lens& lens, const Vec2& px);

/// Squared Sampson distance [px^2] of a pair from b' F a = 0.
inline double sampson_squared(const Mat3& F, const Lifted& a, const Lifted& b) {
  const Vec3 Fa = F * a.v, Fb = F.transpose() * b.v;
  const double c = b.v.dot(Fa);
  const double slope2 = (a.J_v_px.transpose() * Fb).squaredNorm() + (b.J_v_px.transpose() * Fa).squaredNorm();
  return slope2 > 0 ? c * c / slope2 : 0.0;
}

/// Squared Sampson distance [px^2] of a pair from b ~ H a with a positive factor: two equations, with noise
/// in both images (H&Z eq. 4.13). Infinity for a negative factor.
inline double homography_sampson_squared(const Mat3& H, const Lifted& a, const Lifted& b) {
  const Vec3 h = H.col(0) * a.v[0] + H.col(1) * a.v[1] + H.col(2) * a.v[2];
  const double factor = b.measure.dot(h);
  if (!(factor > 0)) return std::numeric_limits<double>::infinity();
  const double unit = 1 / factor;
  const Vec3 j0 = b.J_px_v.row(0) * unit, j1 = b.J_px_v.row(1) * unit;
  const Vec3 u = H.col(0) * a.J_v_px(0, 0) + H.col(1) * a.J_v_px(1, 0) + H.col(2) * a.J_v_px(2, 0);
  const Vec3 v = H.col(0) * a.J_v_px(0, 1) + H.col(1) * a.J_v_px(1, 1) + H.col(2) * a.J_v_px(2, 1);
  const double e0 = j0.dot(h), e1 = j1.dot(h);
  const double m00 = j0.dot(u), m01 = j0.dot(v), m10 = j1.dot(u), m11 = j1.dot(v);
  // e' (I + M M')^-1 e by the adjugate; the determinant is at least 1.
  const double w00 = 1 + m00 * m00 + m01 * m01, w01 = m00 * m10 + m01 * m11, w11 = 1 + m10 * m10 + m11 * m11;
  return (w11 * e0 * e0 - 2 * w01 * e0 * e1 + w00 * e1 * e1) / (w00 * w11 - w01 * w01);
}

/// The signs of the products (e2 x b) . (F a), e2 the left null vector, of pairs before both cameras are all
/// alike (Werner & Pajdla 2001): false when two of these differ.
bool is_oriented(const Mat3& F, std::span<const Lifted> a, std::span<const Lifted> b,
                 std::span<const int> of);

/// The left null vector of a matrix of rank 2, of any length.
inline Vec3 left_null(const Mat3& F) {
  const Vec3 c[3] = {F.col(0).cross(F.col(1)), F.col(1).cross(F.col(2)), F.col(2).cross(F.col(0))};
  const double n[3] = {c[0].squaredNorm(), c[1].squaredNorm(), c[2].squaredNorm()};
  return n[0] >= n[1] ? (n[0] >= n[2] ? c[0] : c[2]) : (n[1] >= n[2] ? c[1] : c[2]);
}

}  // namespace plumbline::detail
