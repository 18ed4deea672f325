// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "plumbline/core/check.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline {
namespace {

// The n x n upper triangular R with R'R = A'A of a tall A, by Householder reflections on pieces that stay in
// the cache. Unlike A'A itself it keeps all digits of the small singular values.
MatX triangular_factor(const MatX& A) {
  constexpr Eigen::Index kPiece = 128;
  const Eigen::Index n = A.cols(), first = std::min(A.rows(), n + kPiece);
  MatX R = Eigen::HouseholderQR<MatX>(A.topRows(first)).matrixQR().topRows(n).triangularView<Eigen::Upper>();
  for (Eigen::Index row = first; row < A.rows(); row += kPiece) {
    const Eigen::Index count = std::min(kPiece, A.rows() - row);
    MatX stacked(n + count, n);
    stacked << R, A.middleRows(row, count);
    R = Eigen::HouseholderQR<MatX>(std::move(stacked)).matrixQR().topRows(n).triangularView<Eigen::Upper>();
  }
  return R;
}

// Turns pairs of columns of L until all are orthogonal, and those of V along: L V' stays what it was, the
// columns' lengths become the singular values of L (one-sided Jacobi, Hestenes 1958). On a triangular factor
// it takes few sweeps (Drmac & Veselic 2008).
void orthogonalise_columns(MatX& L, MatX& V) {
  constexpr double kOrthogonal = 1e-15;  // cosine that rounding leaves
  constexpr int kMaxSweeps = 30;
  const Eigen::Index n = L.cols();
  bool turned = true;
  for (int sweep = 0; turned && sweep < kMaxSweeps; ++sweep) {
    turned = false;
    for (Eigen::Index p = 0; p + 1 < n; ++p) {
      for (Eigen::Index q = p + 1; q < n; ++q) {
        const double a = L.col(p).squaredNorm(), b = L.col(q).squaredNorm(), c = L.col(p).dot(L.col(q));
        if (!(std::abs(c) > kOrthogonal * std::sqrt(a) * std::sqrt(b))) continue;
        turned = true;
        const double cot = (b - a) / (2 * c);
        const double tan = std::copysign(1 / (std::abs(cot) + std::hypot(1.0, cot)), cot);
        const Eigen::JacobiRotation<double> G(1 / std::hypot(1.0, tan), tan / std::hypot(1.0, tan));
        L.applyOnTheRight(p, q, G);
        V.applyOnTheRight(p, q, G);
      }
    }
  }
}

}  // namespace

Svd3 svd3(const Mat3& A) {
  const Eigen::JacobiSVD<Mat3> svd(A, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return {svd.matrixU(), svd.singularValues(), svd.matrixV()};
}

NullVector null_vector(const MatX& A) {
  PLUMBLINE_CHECK(A.cols() > 0 && A.rows() > 0 && A.allFinite(), "null_vector needs a finite matrix");
  const Eigen::Index n = A.cols();
  // A V = (Q1 R) V with R = L Q2': the triangular factor L has the singular values of A.
  const Eigen::HouseholderQR<MatX> lq(A.rows() > n ? MatX(triangular_factor(A).transpose())
                                                   : MatX(A.transpose()));
  const Eigen::Index k = std::min(A.rows(), n);
  MatX L = lq.matrixQR().topRows(k).triangularView<Eigen::Upper>().transpose(), V = MatX::Identity(k, k);
  orthogonalise_columns(L, V);
  const VecX norms = L.colwise().norm();
  std::vector<Eigen::Index> order(static_cast<std::size_t>(k));
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  std::stable_sort(order.begin(), order.end(), [&](auto i, auto j) { return norms[i] > norms[j]; });
  NullVector result{VecX::Zero(n), VecX::Zero(n)};
  for (Eigen::Index i = 0; i < k; ++i) result.singular_values[i] = norms[order[static_cast<std::size_t>(i)]];
  if (k < n) {
    result.v[n - 1] = 1;  // Q2's last column is orthogonal to every row of A
  } else {
    result.v = V.col(order.back());
  }
  result.v.applyOnTheLeft(lq.householderQ());
  result.v.normalize();
  return result;
}

Mat3 nearest_rotation(const Mat3& A) {
  const Svd3 d = svd3(A);
  Vec3 sign(1, 1, (d.U * d.V.transpose()).determinant() < 0 ? -1.0 : 1.0);
  return d.U * sign.asDiagonal() * d.V.transpose();
}

}  // namespace plumbline
