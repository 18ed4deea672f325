// SPDX-License-Identifier: Apache-2.0
#include "plumbline/core/check.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline {

template <int N>
SymEigenFixed<N> sym_eigen_fixed(const Eigen::Matrix<double, N, N>& A) {
  PLUMBLINE_CHECK(A.allFinite(), "sym_eigen_fixed needs a finite matrix");
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, N, N>> solver(A);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

template SymEigenFixed<2> sym_eigen_fixed<2>(const Mat2& A);
template SymEigenFixed<3> sym_eigen_fixed<3>(const Mat3& A);

SymEigen sym_eigen(const MatX& A) {
  PLUMBLINE_CHECK(A.rows() == A.cols() && A.allFinite(), "sym_eigen needs a finite square matrix");
  const Eigen::SelfAdjointEigenSolver<MatX> solver(A);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

std::optional<MatX> solve_spd(const MatX& A, const MatX& b) {
  PLUMBLINE_CHECK(A.rows() == A.cols() && A.rows() == b.rows(), "solve_spd: sizes do not match");
  const Eigen::LLT<MatX> llt(A);
  if (llt.info() != Eigen::Success) return std::nullopt;
  MatX x = llt.solve(b);
  if (!x.allFinite()) return std::nullopt;
  return x;
}

std::optional<VecX> solve_least_squares(const MatX& A, const VecX& b) {
  PLUMBLINE_CHECK(A.rows() == b.rows(), "solve_least_squares: sizes do not match");
  Eigen::ColPivHouseholderQR<MatX> qr(A);
  qr.setThreshold(1e-12);
  if (qr.rank() < A.cols()) return std::nullopt;
  return VecX(qr.solve(b));
}

}  // namespace plumbline
