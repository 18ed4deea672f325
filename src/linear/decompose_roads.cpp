// SPDX-License-Identifier: Apache-2.0
// The two roads from P to K and R beside RQ. Rows of M of unlike length (pixels beside 1) cost digits in an
// inverse and twice as many in M M', so each road first scales the rows to unit length: D M = (D K) R.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "linear/decompose.hpp"
#include "linear/row_qr.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline {
namespace {

struct UnitRows {
  Vec3 lengths;
  Mat3 M;
};

UnitRows unit_rows(const Mat34& P) {
  UnitRows u{P.leftCols<3>().rowwise().norm(), P.leftCols<3>()};
  u.M = u.lengths.cwiseInverse().asDiagonal() * u.M;
  return u;
}

}  // namespace

Result<CameraMatrixParts> decompose_camera_matrix_qr(const Mat34& P) {
  const auto positive = detail::with_positive_determinant(P);
  if (!positive) return positive.error();
  const UnitRows u = unit_rows(*positive);
  // M^-1 = R' K^-1: the orthogonal and the triangular factor of a QR decomposition, whose columns Gram and
  // Schmidt make orthogonal one after the other, each twice so that rounding does not add up.
  const Mat3 inverse = u.M.inverse();
  Mat3 Q = inverse, K_inverse = Mat3::Zero();
  for (int j = 0; j < 3; ++j) {
    for (int pass = 0; pass < 2; ++pass) {
      for (int i = 0; i < j; ++i) {
        const double share = Q.col(i).dot(Q.col(j));
        K_inverse(i, j) += share;
        Q.col(j) -= share * Q.col(i);
      }
    }
    K_inverse(j, j) = Q.col(j).norm();
    Q.col(j) /= K_inverse(j, j);
  }
  return detail::parts_of(*positive, u.lengths.asDiagonal() * detail::inverse_of_upper(K_inverse),
                          Q.transpose());
}

Result<CameraMatrixParts> decompose_camera_matrix_cholesky(const Mat34& P) {
  const auto positive = detail::with_positive_determinant(P);
  if (!positive) return positive.error();
  const UnitRows u = unit_rows(*positive);
  // M M' = K R R' K' = K K' with K UPPER triangular: Cholesky's factor begun at the last row.
  const Mat3 S = u.M * u.M.transpose();
  Mat3 K = Mat3::Zero();
  K(2, 2) = std::sqrt(S(2, 2));
  K(1, 2) = S(1, 2) / K(2, 2);
  K(0, 2) = S(0, 2) / K(2, 2);
  const double k11 = S(1, 1) - K(1, 2) * K(1, 2);
  K(1, 1) = std::sqrt(std::max(k11, 0.0));
  K(0, 1) = K(1, 1) > 0 ? (S(0, 1) - K(0, 2) * K(1, 2)) / K(1, 1) : 0.0;
  const double k00 = S(0, 0) - K(0, 1) * K(0, 1) - K(0, 2) * K(0, 2);
  // The squares of sines between the rows: M M' does not hold what is below the rounding of 1.
  constexpr double kSmallest = 1e-14;
  if (!(std::min(k11, k00) > kSmallest)) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("M M' is not positive definite in double precision (pivot {:.2g}, at least {:.0e} "
                    "is needed); decompose by RQ, which does not square M",
                    std::min(k11, k00), kSmallest),
        "camera matrix"};
  }
  K(0, 0) = std::sqrt(k00);
  const Mat3 R = nearest_rotation(detail::inverse_of_upper(K) * u.M);
  return detail::parts_of(*positive, u.lengths.asDiagonal() * K, R);
}

Result<Vec3> camera_centre_by_inverse(const Mat34& P) {
  const auto positive = detail::with_positive_determinant(P);
  if (!positive) return positive.error();
  const UnitRows u = unit_rows(*positive);
  return Vec3(-u.M.inverse() * positive->col(3).cwiseQuotient(u.lengths));
}

}  // namespace plumbline
