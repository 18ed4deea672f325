// SPDX-License-Identifier: Apache-2.0
// White box: the small least squares of triangulation against Eigen's decompositions.
#include "linear/row_qr.hpp"

#include <gtest/gtest.h>

#include "plumbline/core/linalg.hpp"
#include "plumbline/core/random.hpp"

namespace plumbline::test {
namespace {

MatX random_matrix(Rng& rng, int rows, int cols) {
  MatX A(rows, cols);
  for (double& a : A.reshaped()) a = rng.normal();
  return A;
}

TEST(RowQr, HasTheSameNormalEquations) {
  Rng rng(1);
  for (const int rows : {1, 4, 9}) {
    const MatX A = random_matrix(rng, rows, 4);
    detail::RowQr<4> qr;
    for (int i = 0; i < rows; ++i) qr.add(A.row(i));
    EXPECT_LT((qr.R.transpose() * qr.R - A.transpose() * A).norm(), 1e-14 * A.squaredNorm());
    EXPECT_TRUE(qr.R.isUpperTriangular(0));
  }
}

TEST(RowQr, FindsTheNullVectorThatTheSvdFinds) {
  Rng rng(2);
  for (int trial = 0; trial < 1000; ++trial) {
    // From no noise at all to two singular values of one size.
    const MatX A = random_matrix(rng, 6, 3) * random_matrix(rng, 3, 4) +
                   (trial % 10 == 0 ? 0.0 : std::pow(10, rng.uniform(-14, -1))) * random_matrix(rng, 6, 4);
    detail::RowQr<4> qr;
    for (int i = 0; i < 6; ++i) qr.add(A.row(i));
    const auto null = detail::null_of_upper<4>(qr.R);
    const NullVector svd = null_vector(A);
    const double gap = (svd.singular_values[2] - svd.singular_values[3]) / svd.singular_values[0];
    EXPECT_NEAR(std::abs(null.v.dot(Vec4(svd.v))), 1, 1e-12 + std::pow(1e-14 / gap, 2)) << trial;
    const double ratio = svd.singular_values[2] / svd.singular_values[0];
    EXPECT_LE(null.determinacy, ratio * (1 + 1e-3));
    EXPECT_GE(null.determinacy, ratio / 4);
  }
}

TEST(RowQr, SaysWhenMoreThanOneVectorFits) {
  Rng rng(3);
  const MatX A = random_matrix(rng, 6, 2) * random_matrix(rng, 2, 4);
  detail::RowQr<4> qr;
  for (int i = 0; i < 6; ++i) qr.add(A.row(i));
  EXPECT_LT(detail::null_of_upper<4>(qr.R).determinacy, 1e-9);
  EXPECT_LT(detail::null_of_upper<4>(detail::RowQr<4>().R).determinacy, 1e-9);
}

}  // namespace
}  // namespace plumbline::test
