// SPDX-License-Identifier: Apache-2.0
#include "linear/pixel_pairs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "linear/degeneracy.hpp"
#include "linear/normal_null.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline::detail {

PixelPairs::PixelPairs(std::span<const Vec2> px1, std::span<const Vec2> px2)
    : normaliser_1(normaliser_of(px1)),
      normaliser_2(normaliser_of(px2)),
      T1(normaliser_1.T()),
      T2(normaliser_2.T()),
      a(lift(normaliser_1, px1)),
      b(lift(normaliser_2, px2)) {}

Mat3 PixelPairs::denormalised(const Mat3& F) const { return (T2.transpose() * F * T1).normalized(); }

Mat3 PixelPairs::normalised(const Mat3& F) const {
  return (T2.inverse().transpose() * F * T1.inverse()).normalized();
}

Mat3 PixelPairs::denormalised_homography(const Mat3& H) const {
  if (H.isZero(0)) return H;
  return (T2.inverse() * H * T1).normalized();
}

double PixelPairs::rounding_px() const {
  const auto reach = [](const Normaliser& n) { return n.centre.norm() + std::sqrt(2.0) / n.scale; };
  return kRoundingShare * std::max(reach(normaliser_1), reach(normaliser_2));
}

std::optional<Error> refuse_pixels(std::span<const Vec2> px1, std::span<const Vec2> px2, const char* where) {
  for (std::size_t i = 0; i < px1.size(); ++i) {
    if (!px1[i].allFinite() || !px2[i].allFinite()) {
      return Error{ErrorCode::kInvalidData,
                   fmt::format("pair {} has a coordinate that is not a finite number; remove that pair", i),
                   where};
    }
  }
  for (const auto& px : {px1, px2}) {
    const bool coincide = std::all_of(px.begin(), px.end(), [&](const Vec2& p) { return p == px.front(); });
    if (coincide) {
      return Error{
          ErrorCode::kDegenerate,
          fmt::format("all {} pixels of an image are the same; use points that span the image", px.size()),
          where};
    }
  }
  return std::nullopt;
}

EightPoint eight_point(std::span<const Lifted> a, std::span<const Lifted> b, std::span<const int> of) {
  using Mat9 = Eigen::Matrix<double, 9, 9>;
  using Vec9 = Eigen::Matrix<double, 9, 1>;
  // A'A of the rows vec(b a')' is a sum of products of (a a') and (b b'), six numbers each.
  constexpr int kPlace[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
  Mat6 S = Mat6::Zero();
  for (const int i : of) {
    const Vec3 &x = a[static_cast<std::size_t>(i)].v, &y = b[static_cast<std::size_t>(i)].v;
    Vec6 xx, yy;
    xx << x[0] * x[0], x[0] * x[1], x[0] * x[2], x[1] * x[1], x[1] * x[2], x[2] * x[2];
    yy << y[0] * y[0], y[0] * y[1], y[0] * y[2], y[1] * y[1], y[1] * y[2], y[2] * y[2];
    S.noalias() += yy * xx.transpose();
  }
  Mat9 G;
  for (int c = 0; c < 9; ++c) {
    for (int r = 0; r < 9; ++r) G(r, c) = S(kPlace[r % 3][c % 3], kPlace[r / 3][c / 3]);
  }
  const auto apply = [&](const Vec9& f, double& squares) {
    const Mat3 F = Eigen::Map<const Mat3>(f.data());
    Mat3 sum = Mat3::Zero();
    squares = 0;
    for (const int i : of) {
      const Vec3 &x = a[static_cast<std::size_t>(i)].v, &y = b[static_cast<std::size_t>(i)].v;
      const double r = y.dot(F * x);
      sum.noalias() += (r * y) * x.transpose();
      squares += r * r;
    }
    return Vec9(Eigen::Map<const Vec9>(sum.data()));
  };
  double squares = 0;
  if (const auto null = null_of_normal<9>(G, [&](const Vec9& f) { return apply(f, squares); })) {
    return {Eigen::Map<const Mat3>(null->v.data()), null->determinacy, std::sqrt(squares / G.trace())};
  }
  MatX A(static_cast<Eigen::Index>(of.size()), 9);
  for (std::size_t k = 0; k < of.size(); ++k) {
    const auto i = static_cast<std::size_t>(of[k]);
    for (int c = 0; c < 3; ++c) {
      A.row(static_cast<Eigen::Index>(k)).segment<3>(3 * c) = a[i].v[c] * b[i].v.transpose();
    }
  }
  const NullVector null = null_vector(A);
  const VecX& s = null.singular_values;
  return {Eigen::Map<const Mat3>(null.v.data()), s[7] / s[0], s[8] / s[0]};
}

EightPoint eight_point(std::span<const Lifted> a, std::span<const Lifted> b) {
  std::vector<int> all(a.size());
  std::iota(all.begin(), all.end(), 0);
  return eight_point(a, b, all);
}

Mat3 with_rank_2(const Mat3& F) {
  const Svd3 d = svd3(F);
  return d.U * Vec3(d.s[0], d.s[1], 0).asDiagonal() * d.V.transpose();
}

}  // namespace plumbline::detail
