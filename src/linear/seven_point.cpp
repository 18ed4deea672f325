// SPDX-License-Identifier: Apache-2.0
#include "linear/minimal.hpp"
#include "linear/null_space.hpp"
#include "linear/polynomial_roots.hpp"

namespace plumbline::detail {
namespace {

// Rows are the cross products of the other two rows of M: adj(M)' , the derivative of det M.
Mat3 cofactors(const Mat3& M) {
  Mat3 C;
  C.row(0) = M.row(1).cross(M.row(2));
  C.row(1) = M.row(2).cross(M.row(0));
  C.row(2) = M.row(0).cross(M.row(1));
  return C;
}

}  // namespace

Answers<3> seven_point(const std::array<Vec3, 7>& a, const std::array<Vec3, 7>& b) {
  Eigen::Matrix<double, 9, 7> A;
  for (int i = 0; i < 7; ++i) {
    // Column-major vec(F), each constraint of unit length.
    const Mat3 row = (b[static_cast<std::size_t>(i)].normalized()) *
                     a[static_cast<std::size_t>(i)].normalized().transpose();
    A.col(i) = Eigen::Map<const Eigen::Matrix<double, 9, 1>>(row.data());
  }
  const auto null = null_space<9, 7>(A);
  const Mat3 F1 = Eigen::Map<const Mat3>(null.basis.col(0).data());
  const Mat3 F2 = Eigen::Map<const Mat3>(null.basis.col(1).data());
  const Mat3 C1 = cofactors(F1), C2 = cofactors(F2);
  // det(x F1 + y F2) = sum p[k] x^k y^(3-k)
  const Polynomial<3> p{F2.row(0).dot(C2.row(0)), F1.cwiseProduct(C2).sum(), F2.cwiseProduct(C1).sum(),
                        F1.row(0).dot(C1.row(0))};
  Answers<3> out;
  out.determinacy = null.determinacy;
  visit_projective_roots<3>(p, [&](double x, double y) {
    if (out.n < 3) out.matrix[static_cast<std::size_t>(out.n++)] = (x * F1 + y * F2).normalized();
  });
  return out;
}

}  // namespace plumbline::detail
