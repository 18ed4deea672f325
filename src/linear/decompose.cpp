// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <array>
#include <cmath>

#include "linear/decompose.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline {
namespace {

// |det M| over the product of its rows' lengths: 1 for orthogonal rows, 0 for a singular M, and unlike the
// ratio of the singular values it does not fall with the focal length.
double row_volume(const Mat3& M) {
  const Vec3 lengths = M.rowwise().norm();
  if (!(lengths.minCoeff() > 0)) return 0;
  return std::abs((lengths.cwiseInverse().asDiagonal() * M).determinant());
}
constexpr double kMinVolume = 1e-12;

// The rotation of columns i and j that makes M(row, i) zero.
Mat3 givens(const Mat3& M, int row, int i, int j) {
  const double r = std::hypot(M(row, i), M(row, j));
  Mat3 G = Mat3::Identity();
  if (r == 0) return G;
  const double c = M(row, j) / r, s = M(row, i) / r;
  G(i, i) = c, G(j, j) = c, G(j, i) = -s, G(i, j) = s;
  return G;
}

}  // namespace

Result<Rq> rq_decompose(const Mat3& M) {
  if (!M.allFinite() || row_volume(M) < kMinVolume) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format(
            "the matrix is singular (|det| over the rows' lengths {:.2g}, at least {:.0e} is needed); it "
            "is no product of a camera's K and R",
            M.allFinite() ? row_volume(M) : 0.0, kMinVolume),
        "RQ"};
  }
  Rq rq{M, Mat3::Identity()};
  for (const auto& [row, i, j] : {std::array{2, 0, 2}, std::array{2, 1, 2}, std::array{1, 0, 1}}) {
    const Mat3 G = givens(rq.upper, row, i, j);
    rq.upper = rq.upper * G;
    rq.upper(row, i) = 0;
    rq.orthogonal = G.transpose() * rq.orthogonal;
  }
  // A column of U and the same row of Q may change sign together: the diagonal becomes positive.
  for (int i = 0; i < 3; ++i) {
    if (rq.upper(i, i) < 0) {
      rq.upper.col(i) *= -1;
      rq.orthogonal.row(i) *= -1;
    }
  }
  return rq;
}

namespace detail {

Result<Mat34> with_positive_determinant(const Mat34& P) {
  const Mat3 M = P.leftCols<3>();
  const double volume = P.allFinite() ? row_volume(M) : 0.0;
  if (volume < kMinVolume || M.row(2).norm() < 1e-14 * M.norm()) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format(
            "the left 3x3 block of the camera matrix is singular (|det| over the rows' lengths {:.2g}, "
            "at least {:.0e} is needed): a camera at infinity has no centre to decompose about",
            volume, kMinVolume),
        "camera matrix"};
  }
  return M.determinant() < 0 ? Mat34(-P) : P;
}

CameraMatrixParts parts_of(const Mat34& P, const Mat3& U, const Mat3& R) {
  CameraMatrixParts parts;
  parts.K = U / U(2, 2);
  parts.R = R;
  parts.t.z() = P(2, 3) / U(2, 2);  // back substitution in U t = p4
  parts.t.y() = (P(1, 3) - U(1, 2) * parts.t.z()) / U(1, 1);
  parts.t.x() = (P(0, 3) - U(0, 1) * parts.t.y() - U(0, 2) * parts.t.z()) / U(0, 0);
  parts.centre = camera_centre(P).hnormalized();
  return parts;
}

}  // namespace detail

Result<CameraMatrixParts> decompose_camera_matrix(const Mat34& P) {
  const auto Q = detail::with_positive_determinant(P);
  if (!Q) return Q.error();
  const auto rq = rq_decompose(Q->leftCols<3>());
  if (!rq) return rq.error();
  return detail::parts_of(*Q, rq->upper, rq->orthogonal);
}

Vec4 camera_centre(const Mat34& P) {
  PLUMBLINE_CHECK(P.allFinite(), "camera_centre needs a finite camera matrix");
  // The length of a row says nothing about the null space, and pixels make the first two 1000 times the
  // third.
  Mat34 rows = P;
  for (int i = 0; i < 3; ++i) {
    if (const double length = rows.row(i).norm(); length > 0) rows.row(i) /= length;
  }
  const Vec4 C = null_vector(rows).v;
  return C.w() < 0 ? Vec4(-C) : C;
}

}  // namespace plumbline
