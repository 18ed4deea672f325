// SPDX-License-Identifier: Apache-2.0
#include "plumbline/core/check.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline {
namespace {

template <int N>
SymEigen sym_eigen_of(const MatX& A) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, N, N>> solver(A);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

}  // namespace

SymEigen sym_eigen(const MatX& A) {
  PLUMBLINE_CHECK(A.rows() == A.cols() && A.allFinite(), "sym_eigen needs a finite square matrix");
  if (A.rows() == 2) return sym_eigen_of<2>(A);
  if (A.rows() == 3) return sym_eigen_of<3>(A);
  return sym_eigen_of<Eigen::Dynamic>(A);
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
