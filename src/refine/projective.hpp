// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cmath>
#include <span>
#include <vector>

#include "plumbline/core/types.hpp"
#include "refine/small_solve.hpp"

/// What the refinements of homographies and camera matrices share: both are 3 x K matrices up to scale, kept
/// as unit vectors in normalised coordinates and moved along the sphere. Private to the module.
namespace plumbline::detail {

/// Vector of a matrix row by row, the order of every covariance here.
template <int K>
using RowVector3K = Eigen::Matrix<double, 3 * K, 1>;

template <int K>
RowVector3K<K> row_major(const Eigen::Matrix<double, 3, K>& M) {
  RowVector3K<K> v;
  v << M.row(0).transpose(), M.row(1).transpose(), M.row(2).transpose();
  return v;
}

template <int K>
Eigen::Matrix<double, 3, K> from_row_major(const RowVector3K<K>& v) {
  return Eigen::Map<const Eigen::Matrix<double, K, 3>>(v.data()).transpose();
}

/// Columns that span the tangent space of the unit sphere at v: those of the reflection that takes v to an
/// axis, but for v itself. A function of v alone.
template <int N>
Eigen::Matrix<double, N, N - 1> tangent_basis(const Eigen::Matrix<double, N, 1>& v) {
  Eigen::Matrix<double, N, 1> w = v;
  w[0] += std::copysign(1.0, v[0]);
  Eigen::Matrix<double, N, N> reflection = Eigen::Matrix<double, N, N>::Identity();
  reflection -= 2 / w.squaredNorm() * w * w.transpose();
  return reflection.template rightCols<N - 1>();
}

/// The similarity to centroid 0 and RMS distance sqrt(D) (Hartley 1997), x = scale (point - centroid).
template <int D>
struct Similarity {
  Eigen::Matrix<double, D, 1> centroid = Eigen::Matrix<double, D, 1>::Zero();
  double scale = 1;

  explicit Similarity(std::span<const Eigen::Matrix<double, D, 1>> points) {
    const double n = static_cast<double>(points.size());
    double sum = 0;
    for (const auto& p : points) centroid += p / n;
    for (const auto& p : points) sum += (p - centroid).squaredNorm() / n;
    if (sum > 0) scale = std::sqrt(D / sum);
  }
  Eigen::Matrix<double, D + 1, D + 1> matrix() const {
    Eigen::Matrix<double, D + 1, D + 1> T = Eigen::Matrix<double, D + 1, D + 1>::Identity();
    T.template topLeftCorner<D, D>() *= scale;
    T.template topRightCorner<D, 1>() = -scale * centroid;
    return T;
  }
  std::vector<Eigen::Matrix<double, D, 1>> operator()(
      std::span<const Eigen::Matrix<double, D, 1>> points) const {
    std::vector<Eigen::Matrix<double, D, 1>> out;
    out.reserve(points.size());
    for (const auto& p : points) out.push_back(scale * (p - centroid));
    return out;
  }
};

/// Normal equations of residuals of image points (u, v) = (x / w, y / w) of x = M X, along the entries of M:
/// the derivative is E/w x X' with E = [1 0 -u; 0 1 -v], so that J'J is made of blocks  (E'WE)(r, c) X X' /
/// w^2.
template <int K>
class ProjectiveSums {
 public:
  using VecK = Eigen::Matrix<double, K, 1>;

  /// A point X imaged at uv with this w: weight W of the residual's two coordinates, and W times the
  /// residual.
  void add(const VecK& X, const Vec2& uv, double w, const Mat2& W, const Vec2& W_residual) {
    Mat23 E;
    E << 1 / w, 0, -uv.x() / w, 0, 1 / w, -uv.y() / w;
    const Mat3 weights = E.transpose() * W * E;
    const Eigen::Matrix<double, K, K> XX = X * X.transpose();
    for (int i = 0, block = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j, ++block) moments_[block] += weights(i, j) * XX;
    }
    gradient_.noalias() += X * (E.transpose() * W_residual).transpose();
  }

  /// A and g along the tangent basis B at the state.
  void write(const Eigen::Matrix<double, 3 * K, 3 * K - 1>& B, NormalEquations<3 * K - 1>& out) const {
    Eigen::Matrix<double, 3 * K, 3 * K> A;
    for (int i = 0, block = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j, ++block) {
        A.template block<K, K>(K * i, K * j) = A.template block<K, K>(K * j, K * i) = moments_[block];
      }
    }
    out.A.noalias() = B.transpose() * A * B;
    out.g.noalias() = B.transpose() * Eigen::Map<const RowVector3K<K>>(gradient_.data());
  }

 private:
  Eigen::Matrix<double, K, K> moments_[6] = {
      Eigen::Matrix<double, K, K>::Zero(), Eigen::Matrix<double, K, K>::Zero(),
      Eigen::Matrix<double, K, K>::Zero(), Eigen::Matrix<double, K, K>::Zero(),
      Eigen::Matrix<double, K, K>::Zero(), Eigen::Matrix<double, K, K>::Zero()};
  Eigen::Matrix<double, K, 3> gradient_ = Eigen::Matrix<double, K, 3>::Zero();
};

/// The step along the sphere.
template <int N>
Eigen::Matrix<double, N, 1> plus_on_sphere(const Eigen::Matrix<double, N, 1>& v,
                                           const Eigen::Matrix<double, N - 1, 1>& d) {
  return (v + tangent_basis<N>(v) * d).normalized();
}

/// The matrix and its covariance out of normalised coordinates: M = left M_n right, scaled to |M| = 1.
template <int K>
struct Denormalised {
  Eigen::Matrix<double, 3, K> M;
  Eigen::Matrix<double, 3 * K, 3 * K> covariance;
};
template <int K>
Denormalised<K> denormalised(const RowVector3K<K>& state,
                             const Eigen::Matrix<double, 3 * K - 1, 3 * K - 1>& tangent_covariance,
                             const Mat3& left, const Eigen::Matrix<double, K, K>& right) {
  constexpr int N = 3 * K;
  Eigen::Matrix<double, N, N> map;  // row by row: vec(L M R) = (L x R') vec(M)
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) map.template block<K, K>(K * i, K * j) = left(i, j) * right.transpose();
  }
  const RowVector3K<K> m = map * state;
  const double length = m.norm();
  const RowVector3K<K> unit = m / length;
  Eigen::Matrix<double, N, N - 1> J = map * tangent_basis<N>(state) / length;
  J -= unit * (unit.transpose() * J).eval();
  return {from_row_major<K>(unit), J * tangent_covariance * J.transpose()};
}

}  // namespace plumbline::detail
