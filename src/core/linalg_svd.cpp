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

// Turns pairs of columns of L, the upper N rows of LV, until all are orthogonal, and those of V, the lower
// rows, along: L V' stays what it was and the columns' lengths become the singular values of L (one-sided
// Jacobi, Hestenes 1958). On a triangular factor it takes few sweeps (Drmac & Veselic 2008).
template <int N, int N2>
void orthogonalise_columns(Eigen::Matrix<double, N2, N>& LV) {
  constexpr double kOrthogonal = 1e-15;  // cosine that rounding leaves
  constexpr int kMaxSweeps = 30;
  const Eigen::Index n = LV.cols();
  const auto upper = [&](Eigen::Index i) { return LV.col(i).template head<N>(n); };
  bool turned = true;
  for (int sweep = 0; turned && sweep < kMaxSweeps; ++sweep) {
    turned = false;
    for (Eigen::Index p = 0; p + 1 < n; ++p) {
      for (Eigen::Index q = p + 1; q < n; ++q) {
        const double a = upper(p).squaredNorm(), b = upper(q).squaredNorm(), c = upper(p).dot(upper(q));
        if (!(std::abs(c) > kOrthogonal * std::sqrt(a) * std::sqrt(b))) continue;
        turned = true;
        const double cot = (b - a) / (2 * c);
        const double tan = std::copysign(1 / (std::abs(cot) + std::sqrt(1 + cot * cot)), cot);
        const double cosine = 1 / std::sqrt(1 + tan * tan);
        LV.applyOnTheRight(p, q, Eigen::JacobiRotation<double>(cosine, tan * cosine));
      }
    }
  }
}

template <int N>
MatX orthogonalised(const MatX& LV) {
  constexpr int N2 = N == Eigen::Dynamic ? N : 2 * N;
  Eigen::Matrix<double, N2, N> work = LV;
  orthogonalise_columns<N, N2>(work);
  return work;
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
  MatX LV(2 * k, k);
  LV.topRows(k) = lq.matrixQR().topRows(k).triangularView<Eigen::Upper>().transpose();
  LV.bottomRows(k).setIdentity();
  // The sizes of cameras, epipolar geometry and points have code of their own.
  LV = k == 12  ? orthogonalised<12>(LV)
       : k == 9 ? orthogonalised<9>(LV)
       : k == 4 ? orthogonalised<4>(LV)
                : orthogonalised<Eigen::Dynamic>(LV);
  const VecX norms = LV.topRows(k).colwise().norm();
  std::vector<Eigen::Index> order(static_cast<std::size_t>(k));
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  std::stable_sort(order.begin(), order.end(), [&](auto i, auto j) { return norms[i] > norms[j]; });
  NullVector result{VecX::Zero(n), VecX::Zero(n)};
  for (Eigen::Index i = 0; i < k; ++i) result.singular_values[i] = norms[order[static_cast<std::size_t>(i)]];
  if (k < n) {
    result.v[n - 1] = 1;  // Q2's last column is orthogonal to every row of A
  } else {
    result.v = LV.col(order.back()).tail(k);
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
