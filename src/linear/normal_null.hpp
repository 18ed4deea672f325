// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <cmath>
#include <optional>

#include "plumbline/core/types.hpp"

/// The null vector of a tall matrix A from A'A, as exact as from A. Private to the module.
namespace plumbline::detail {

/// L with L L' = A, of a positive definite A; nullopt when there is none.
template <int N>
std::optional<Eigen::Matrix<double, N, N>> cholesky_factor(Eigen::Matrix<double, N, N> A) {
  for (int j = 0; j < N; ++j) {
    for (int k = 0; k < j; ++k) A.col(j).tail(N - j) -= A(j, k) * A.col(k).tail(N - j);
    if (!(A(j, j) > 0) || !std::isfinite(A(j, j))) return std::nullopt;
    A.col(j).tail(N - j) /= std::sqrt(A(j, j));
  }
  return A;
}

/// x with L L' x = b; the upper triangle of L is not read.
template <int N>
Eigen::Matrix<double, N, 1> factor_solve(const Eigen::Matrix<double, N, N>& L,
                                         Eigen::Matrix<double, N, 1> b) {
  for (int j = 0; j < N; ++j) {
    b[j] /= L(j, j);
    b.tail(N - j - 1) -= b[j] * L.col(j).tail(N - j - 1);
  }
  for (int j = N - 1; j >= 0; --j) {
    b[j] = (b[j] - L.col(j).tail(N - j - 1).dot(b.tail(N - j - 1))) / L(j, j);
  }
  return b;
}

template <int N>
struct NormalNull {
  Eigen::Matrix<double, N, 1> v;     ///< the unit vector that minimises |A v|
  Eigen::Matrix<double, N, 1> next;  ///< nearly the one across v that does: within some per cent of the least
  double determinacy;                ///< |A next| over the square root of the trace of A'A
};

/// From G = A'A, and gradient(v) = A'(A v) computed from A itself. G alone would cost half of the digits; one
/// correction with the gradient brings them back ("corrected seminormal equations", Bjorck 1987). nullopt
/// when the last but one singular value is below 1e-4 of the largest or the last is close to it: then G does
/// not hold the answer and A must be decomposed.
template <int N, class Gradient>
std::optional<NormalNull<N>> null_of_normal(const Eigen::Matrix<double, N, N>& G, Gradient&& gradient) {
  using Vector = Eigen::Matrix<double, N, 1>;
  using Matrix = Eigen::Matrix<double, N, N>;
  constexpr double kShift = 1e-15;  // of the trace: keeps the last pivot positive, far below sigma_{N-1}^2
  constexpr double kSmallestGap = 1e-8;  // (1e-4)^2: one correction leaves the square of 1e-16 / 1e-8
  constexpr int kMaxIterations = 12, kNextIterations = 6;
  const double trace = G.trace();
  if (!(trace > 0) || !std::isfinite(trace)) return std::nullopt;
  const Matrix unit = G / trace;
  const auto L = cholesky_factor<N>(unit + N * kShift * Matrix::Identity());
  if (!L) return std::nullopt;
  Vector v;
  for (int i = 0; i < N; ++i) v[i] = 1 + 0.37 * ((7 * i) % 5) - 0.21 * ((3 * i) % 4);  // of no symmetry
  v.normalize();
  for (int k = 0, settled = 0; settled < 2; ++k) {
    if (k == kMaxIterations) return std::nullopt;
    const Vector next = factor_solve<N>(*L, v).normalized();
    const double moved = std::min((next - v).squaredNorm(), (next + v).squaredNorm());
    v = next;
    settled = moved < 1e-20 ? settled + 1 : 0;
  }
  Matrix inverse;  // across v
  for (int i = 0; i < N; ++i) {
    const Vector x = factor_solve<N>(*L, Vector::Unit(i) - v[i] * v);
    inverse.col(i) = x - v.dot(x) * v;
  }
  // Its trace bounds the eigenvalue after v's from below, its largest eigenvector is the one wanted.
  if (!(1 / inverse.trace() > kSmallestGap)) return std::nullopt;
  Eigen::Index largest = 0;
  inverse.diagonal().maxCoeff(&largest);
  Vector next = inverse.col(largest).normalized();
  for (int k = 0; k < kNextIterations; ++k) next = (inverse * next).normalized();
  v = (v - inverse * (gradient(v) / trace)).normalized();
  return NormalNull<N>{v, next, std::sqrt(next.dot(unit * next))};
}

}  // namespace plumbline::detail
