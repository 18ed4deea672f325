// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <cmath>

#include "plumbline/core/linalg.hpp"
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

/// The unit vector that minimises |R v| of an upper triangle R, by inverse iteration, or by SVD.
template <int N>
struct UpperNull {
  Eigen::Matrix<double, N, 1> v;
  double determinacy = 0;  ///< last but one singular value over the largest, within a factor N below
};
template <int N>
UpperNull<N> null_of_upper(Eigen::Matrix<double, N, N, Eigen::RowMajor> R) {
  const double size = R.norm(), floor = std::max(1e-13 * size, 1e-300);
  UpperNull<N> null;
  // Rows that leave a small pivot before the last (a point at infinity) would need pivoting.
  if (!(R.diagonal().template head<N - 1>().cwiseAbs().minCoeff() > 1e-6 * size)) {
    const NullVector svd = null_vector(R);
    null.v = svd.v;
    null.determinacy = size > 0 ? svd.singular_values[N - 2] / size : 0.0;
    return null;
  }
  // The last may be rounding: the null vector does not depend on it to first order.
  if (!(std::abs(R(N - 1, N - 1)) > floor)) R(N - 1, N - 1) = floor;
  const Eigen::Matrix<double, N, N> inverse = inverse_of_upper(R);
  null.v = inverse.col(N - 1).normalized();
  for (int k = 0; k < 60; ++k) {
    const Eigen::Matrix<double, N, 1> back = inverse.transpose() * null.v,
                                      next = (inverse * back).normalized();
    const double moved = (next - null.v).squaredNorm();  // inverse iteration keeps the sign
    null.v = next;
    if (moved < 1e-31) break;
  }
  // The inverse is the sum of v_i u_i' / s_i: without its part along v the largest term is that of s_(N-1).
  const double rest = (inverse - null.v * (null.v.transpose() * inverse)).norm();
  null.determinacy = 1 / (rest * size);
  return null;
}

}  // namespace plumbline::detail
