// SPDX-License-Identifier: Apache-2.0
#include "plumbline/core/check.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline {

Svd3 svd3(const Mat3& A) {
  const Eigen::JacobiSVD<Mat3> svd(A, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return {svd.matrixU(), svd.singularValues(), svd.matrixV()};
}

NullVector null_vector(const MatX& A) {
  PLUMBLINE_CHECK(A.cols() > 0 && A.rows() > 0 && A.allFinite(), "null_vector needs a finite matrix");
  const Eigen::JacobiSVD<MatX> svd(A, Eigen::ComputeFullV);
  NullVector result{svd.matrixV().col(A.cols() - 1), VecX::Zero(A.cols())};
  result.singular_values.head(svd.singularValues().size()) = svd.singularValues();
  return result;
}

NullVector4 null_vector4(const Mat4& A) {
  PLUMBLINE_CHECK(A.allFinite(), "null_vector4 needs a finite matrix");
  const Eigen::JacobiSVD<Mat4> svd(A, Eigen::ComputeFullV);
  return {svd.matrixV().col(3), svd.singularValues()};
}

Mat3 nearest_rotation(const Mat3& A) {
  const Svd3 d = svd3(A);
  Vec3 sign(1, 1, (d.U * d.V.transpose()).determinant() < 0 ? -1.0 : 1.0);
  return d.U * sign.asDiagonal() * d.V.transpose();
}

}  // namespace plumbline
