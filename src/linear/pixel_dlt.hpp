// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "linear/normal_null.hpp"
#include "plumbline/core/linalg.hpp"
#include "plumbline/core/types.hpp"

/// Direct linear transformation of points onto pixels, in fixed sizes and few passes over the points. Private
/// to the module.
namespace plumbline::detail {

template <int D>
using Point = Eigen::Matrix<double, D, 1>;

/// Points moved to centroid 0 and RMS distance sqrt(D) from it (Hartley 1997), and how they lie.
template <int D>
struct Normalised {
  Eigen::Matrix<double, D + 1, D + 1> T;  ///< the similarity; not finite when a coordinate is not
  std::vector<Point<D>> x;
  double flatness;  ///< smallest over largest principal extent, 0 for points that coincide
  double leverage;  ///< the largest hat value: 1 when one point alone keeps the others from being flat
};

template <int D>
Normalised<D> normalise(std::span<const Point<D>> points) {
  using Square = Eigen::Matrix<double, D, D>;
  const double n = static_cast<double>(points.size());
  Point<D> centroid = Point<D>::Zero();
  for (const Point<D>& p : points) centroid += p;
  centroid /= n;
  Normalised<D> out{Eigen::Matrix<double, D + 1, D + 1>::Identity(), {}, 0, 1};
  if (!centroid.allFinite()) {
    out.T.setConstant(std::numeric_limits<double>::quiet_NaN());
    return out;
  }
  Square scatter = Square::Zero();
  for (const Point<D>& p : points) {
    const Point<D> c = p - centroid;
    scatter += c * c.transpose();
  }
  scatter /= n;
  const double trace = scatter.trace(), scale = trace > 0 ? std::sqrt(D / trace) : 1.0;
  const auto eigen = sym_eigen_fixed<D>(scatter);
  if (eigen.values[0] > 0) out.flatness = std::sqrt(eigen.values[0] / eigen.values[D - 1]);
  // Along the principal axes, in units of the extents, the squared length is the hat value times n.
  const Square whiten = (scale * eigen.values.cwiseMax(1e-300).cwiseSqrt()).cwiseInverse().asDiagonal() *
                        eigen.vectors.transpose();
  double longest = 0;
  out.x.reserve(points.size());
  for (const Point<D>& p : points) {
    out.x.push_back(scale * (p - centroid));
    longest = std::max(longest, (whiten * out.x.back()).squaredNorm());
  }
  if (eigen.values[0] > 0) out.leverage = (1 + longest) / n;
  out.T.template topLeftCorner<D, D>() *= scale;
  out.T.template topRightCorner<D, 1>() = -scale * centroid;
  return out;
}

/// The 3 x K matrix that takes points to pixels, K = 3 (of a plane) or 4.
template <int K>
struct PixelDlt {
  Eigen::Matrix<double, 3, K> H;     ///< unit norm
  Eigen::Matrix<double, 3, K> next;  ///< the unit matrix across H that comes next, to some per cent
  double determinacy;                ///< as DltSolution's
};

/// A'A of the rows [a, 0, -x a; 0, a, -y a] for points a (homogeneous) and pixels (x, y), both normalised:
/// blocks of the sums of a a', x a a', y a a' and (x^2 + y^2) a a'.
template <int K>
Eigen::Matrix<double, 3 * K, 3 * K> pixel_normal_matrix(std::span<const Point<K - 1>> a,
                                                        std::span<const Vec2> b) {
  constexpr int kPairs = K * (K + 1) / 2;
  Eigen::Matrix<double, kPairs, 4> sums = Eigen::Matrix<double, kPairs, 4>::Zero();
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Point<K> p = a[i].homogeneous();
    Eigen::Matrix<double, kPairs, 1> q;
    for (int r = 0, at = 0; r < K; ++r) {
      for (int c = r; c < K; ++c) q[at++] = p[r] * p[c];
    }
    sums.col(0) += q;
    sums.col(1) += b[i].x() * q;
    sums.col(2) += b[i].y() * q;
    sums.col(3) += b[i].squaredNorm() * q;
  }
  Eigen::Matrix<double, 3 * K, 3 * K> G;
  G.setZero();
  for (int r = 0, at = 0; r < K; ++r) {
    for (int c = r; c < K; ++c, ++at) {
      for (const auto& [i, j] : {std::pair{r, c}, std::pair{c, r}}) {
        G(i, j) = G(K + i, K + j) = sums(at, 0);
        G(i, 2 * K + j) = G(2 * K + i, j) = -sums(at, 1);
        G(K + i, 2 * K + j) = G(2 * K + i, K + j) = -sums(at, 2);
        G(2 * K + i, 2 * K + j) = sums(at, 3);
      }
    }
  }
  return G;
}

/// Their sum of  row (row h), the rows taken from the points again.
template <int K>
Eigen::Matrix<double, 3 * K, 1> pixel_gradient(std::span<const Point<K - 1>> a, std::span<const Vec2> b,
                                               const Eigen::Matrix<double, 3 * K, 1>& h) {
  Point<K> sum0 = Point<K>::Zero(), sum1 = sum0, sum2 = sum0;
  const Point<K> h0 = h.template head<K>(), h1 = h.template segment<K>(K), h2 = h.template tail<K>();
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Point<K> p = a[i].homogeneous();
    const double w = h2.dot(p), rx = h0.dot(p) - b[i].x() * w, ry = h1.dot(p) - b[i].y() * w;
    sum0 += rx * p;
    sum1 += ry * p;
    sum2 -= (b[i].x() * rx + b[i].y() * ry) * p;
  }
  Eigen::Matrix<double, 3 * K, 1> out;
  out << sum0, sum1, sum2;
  return out;
}

/// By decomposition of the rows themselves, for systems that nearly have too small a rank.
template <int K>
PixelDlt<K> solve_pixel_rows(std::span<const Point<K - 1>> a, std::span<const Vec2> b) {
  const Eigen::Index n = static_cast<Eigen::Index>(a.size());
  MatX A = MatX::Zero(2 * n + 1, 3 * K);  // the last row is for the deflation below
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const Eigen::Matrix<double, 1, K> p = a[k].homogeneous().transpose();
    A.template block<1, K>(2 * i, 0) = A.template block<1, K>(2 * i + 1, K) = p;
    A.template block<1, K>(2 * i, 2 * K) = -b[k].x() * p;
    A.template block<1, K>(2 * i + 1, 2 * K) = -b[k].y() * p;
  }
  const NullVector null = null_vector(A.topRows(2 * n));
  const double largest = null.singular_values[0], last_but_one = null.singular_values[3 * K - 2];
  // With the null vector as a row of largest weight the next one is last.
  A.row(2 * n) = std::max(largest, 1.0) * null.v.transpose();
  const VecX next = null_vector(A).v;
  return {Eigen::Map<const Eigen::Matrix<double, K, 3>>(null.v.data()).transpose(),
          Eigen::Map<const Eigen::Matrix<double, K, 3>>(next.data()).transpose(),
          largest > 0 ? last_but_one / largest : 0.0};
}

template <int K>
PixelDlt<K> solve_pixel_dlt(std::span<const Point<K - 1>> a, std::span<const Vec2> b) {
  const auto null = null_of_normal<3 * K>(
      pixel_normal_matrix<K>(a, b),
      [&](const Eigen::Matrix<double, 3 * K, 1>& h) { return pixel_gradient<K>(a, b, h); });
  if (!null) return solve_pixel_rows<K>(a, b);
  return {Eigen::Map<const Eigen::Matrix<double, K, 3>>(null->v.data()).transpose(),
          Eigen::Map<const Eigen::Matrix<double, K, 3>>(null->next.data()).transpose(), null->determinacy};
}

}  // namespace plumbline::detail
