// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cmath>

#include "plumbline/core/types.hpp"

/// Private to the module.
namespace plumbline::detail {

/// Least squares with few columns and any number of rows, taken in one by one by Givens rotations: R is the
/// upper triangle with R'R = A'A of the rows so far. Nothing is allocated, and the condition is not squared
/// as in A'A.
template <int N>
struct RowQr {
  Eigen::Matrix<double, N, N, Eigen::RowMajor> R = Eigen::Matrix<double, N, N, Eigen::RowMajor>::Zero();

  void add(Eigen::Matrix<double, 1, N> row) {
    for (int k = 0; k < N; ++k) {
      if (row[k] == 0) continue;
      const double r = std::sqrt(R(k, k) * R(k, k) + row[k] * row[k]);
      const double c = R(k, k) / r, s = row[k] / r;
      for (int j = k; j < N; ++j) {
        const double a = R(k, j), b = row[j];
        R(k, j) = c * a + s * b;
        row[j] = c * b - s * a;
      }
    }
  }
};

/// R^-1 of an upper triangle; not finite when a diagonal element is 0.
template <class Derived>
typename Derived::PlainObject inverse_of_upper(const Eigen::MatrixBase<Derived>& R) {
  typename Derived::PlainObject inverse = Derived::PlainObject::Identity(R.rows(), R.cols());
  for (Eigen::Index i = R.rows() - 1; i >= 0; --i) {
    for (Eigen::Index k = i + 1; k < R.rows(); ++k) inverse.row(i) -= R(i, k) * inverse.row(k);
    inverse.row(i) /= R(i, i);
  }
  return inverse;
}

}  // namespace plumbline::detail
