// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>

#include "plumbline/core/types.hpp"

/// The linear-algebra firewall. Eigen's decompositions cost 3 to 29 s of compile time in each file that names
/// one, so src/core/linalg_*.cpp are the only files that do (a test checks it), and these are their names.
namespace plumbline {

/// A = U diag(s) V', s descending.
struct Svd3 {
  Mat3 U;
  Vec3 s;
  Mat3 V;
};
Svd3 svd3(const Mat3& A);

/// The unit vector v that minimises |A v|, with all singular values (descending; cols(A) of them, zero-padded
/// where rows(A) < cols(A)). The null space is one-dimensional when the last but one is clearly above zero.
struct NullVector {
  VecX v;
  VecX singular_values;
};
NullVector null_vector(const MatX& A);

/// Eigenvalues ascending with their unit eigenvectors as columns, of a symmetric A (lower triangle is read).
struct SymEigen {
  VecX values;
  MatX vectors;
};
SymEigen sym_eigen(const MatX& A);

/// The same of a 2x2 or 3x3 matrix, without allocation.
template <int N>
struct SymEigenFixed {
  Eigen::Matrix<double, N, 1> values;
  Eigen::Matrix<double, N, N> vectors;
};
template <int N>
SymEigenFixed<N> sym_eigen_fixed(const Eigen::Matrix<double, N, N>& A);
extern template SymEigenFixed<2> sym_eigen_fixed<2>(const Mat2& A);
extern template SymEigenFixed<3> sym_eigen_fixed<3>(const Mat3& A);

/// x with A x = b for symmetric positive definite A, or nullopt when the Cholesky factor does not exist.
std::optional<MatX> solve_spd(const MatX& A, const MatX& b);

/// Least-squares solution of A x = b by a rank-revealing QR; nullopt when A has not full column rank
/// (pivot ratio below 1e-12).
std::optional<VecX> solve_least_squares(const MatX& A, const VecX& b);

/// The rotation nearest to A in the Frobenius norm (orthogonal Procrustes; Kabsch 1976): det +1.
Mat3 nearest_rotation(const Mat3& A);

}  // namespace plumbline
