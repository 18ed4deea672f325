// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cmath>
#include <utility>

#include "plumbline/core/types.hpp"

/// The null space of a few constraints of fixed number, without the heap, for minimal solvers. Private to the
/// module.
namespace plumbline::detail {

template <int N, int M>
struct NullSpace {
  Eigen::Matrix<double, N, N - M> basis;  ///< orthonormal columns
  double determinacy;  ///< smallest over largest pivot: near 0 when the constraints are dependent, and the
                       ///< null space is larger than `basis`
};

/// The vectors orthogonal to the M columns of A in R^N: Householder's QR with column pivoting (Golub & Van
/// Loan 2013, alg. 5.4.1), whose last columns of Q they are.
template <int N, int M>
NullSpace<N, M> null_space(Eigen::Matrix<double, N, M> A) {
  static_assert(M < N);
  NullSpace<N, M> out;
  double first = 0, last = 0;
  Eigen::Matrix<double, N, M> reflectors;
  for (int k = 0; k < M; ++k) {
    int pivot = k;
    double largest = -1;
    for (int j = k; j < M; ++j) {
      const double norm2 = A.col(j).tail(N - k).squaredNorm();
      if (norm2 > largest) largest = norm2, pivot = j;
    }
    if (pivot != k) A.col(k).swap(A.col(pivot));
    const double norm = std::sqrt(largest);
    if (k == 0) first = norm;
    last = norm;
    auto v = reflectors.col(k).tail(N - k);
    v = A.col(k).tail(N - k);
    v[0] += v[0] < 0 ? -norm : norm;
    const double v2 = v.squaredNorm();
    if (v2 > 0) v *= std::sqrt(2 / v2);  // H = I - v v'
    for (int j = k + 1; j < M; ++j) A.col(j).tail(N - k) -= v.dot(A.col(j).tail(N - k)) * v;
  }
  out.basis.setZero();
  out.basis.template bottomRows<N - M>().setIdentity();
  for (int k = M - 1; k >= 0; --k) {
    const auto v = reflectors.col(k).tail(N - k);
    for (int j = 0; j < N - M; ++j) out.basis.col(j).tail(N - k) -= v.dot(out.basis.col(j).tail(N - k)) * v;
  }
  out.determinacy = first > 0 ? last / first : 0.0;
  return out;
}

}  // namespace plumbline::detail
