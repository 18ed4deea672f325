// SPDX-License-Identifier: Apache-2.0
#include "plumbline/core/linalg.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "plumbline/core/random.hpp"

namespace plumbline {
namespace {

MatX random_matrix(Rng& rng, int rows, int cols) {
  MatX A(rows, cols);
  for (int i = 0; i < A.size(); ++i) A.data()[i] = rng.normal();
  return A;
}

Mat3 random_rotation(Rng& rng) {
  return Eigen::Quaterniond(rng.normal(), rng.normal(), rng.normal(), rng.normal())
      .normalized()
      .toRotationMatrix();
}

TEST(Svd3, ComposesBackAndIsOrdered) {
  Rng rng(1);
  for (int i = 0; i < 100; ++i) {
    Mat3 A = random_matrix(rng, 3, 3);
    if (i % 3 == 0) A.col(2) = A.col(0);  // rank 2
    const Svd3 d = svd3(A);
    EXPECT_LT((d.U * d.s.asDiagonal() * d.V.transpose() - A).norm(), 1e-14 * A.norm());
    EXPECT_LT((d.U.transpose() * d.U - Mat3::Identity()).norm(), 1e-14);
    EXPECT_LT((d.V.transpose() * d.V - Mat3::Identity()).norm(), 1e-14);
    EXPECT_TRUE(d.s[0] >= d.s[1] && d.s[1] >= d.s[2] && d.s[2] >= 0) << d.s.transpose();
  }
}

TEST(NullVector, FindsThePlantedNullSpace) {
  Rng rng(2);
  for (int rows : {11, 12, 60}) {
    const VecX truth = random_matrix(rng, 12, 1).col(0).normalized();
    const MatX A = random_matrix(rng, rows, 12) * (MatX::Identity(12, 12) - truth * truth.transpose());
    const NullVector n = null_vector(A);
    EXPECT_NEAR(std::abs(n.v.dot(truth)), 1, 1e-13) << rows;
    EXPECT_NEAR(n.v.norm(), 1, 1e-14);
    ASSERT_EQ(n.singular_values.size(), 12);
    EXPECT_LT(n.singular_values[11], 1e-13 * n.singular_values[0]);
    EXPECT_GT(n.singular_values[10], 1e-3 * n.singular_values[0]);
  }
}

TEST(NullVector, OfAFullRankMatrixMinimisesTheNorm) {
  Rng rng(3);
  const MatX A = random_matrix(rng, 20, 5);
  const NullVector n = null_vector(A);
  EXPECT_NEAR((A * n.v).norm(), n.singular_values[4], 1e-13);
  for (int i = 0; i < 1000; ++i) {
    EXPECT_GE((A * random_matrix(rng, 5, 1).normalized()).norm(), n.singular_values[4] * (1 - 1e-12));
  }
}

TEST(NullVector, FewerRowsThanColumnsPadsWithZeros) {
  Rng rng(4);
  const MatX A = random_matrix(rng, 2, 5);
  const NullVector n = null_vector(A);
  EXPECT_LT((A * n.v).norm(), 1e-14 * A.norm());
  ASSERT_EQ(n.singular_values.size(), 5);
  EXPECT_EQ(n.singular_values.tail(3).norm(), 0);
  EXPECT_THROW(null_vector(MatX::Constant(3, 3, std::nan(""))), std::invalid_argument);
  EXPECT_THROW(null_vector(MatX(0, 0)), std::invalid_argument);
}

TEST(SymEigen, ComposesBackAndIsAscending) {
  Rng rng(5);
  const MatX B = random_matrix(rng, 6, 6);
  const MatX A = B + B.transpose();
  MatX lower = A;
  lower.triangularView<Eigen::StrictlyUpper>().setConstant(123);  // only the lower triangle may be read
  const SymEigen e = sym_eigen(lower);
  EXPECT_LT((e.vectors * e.values.asDiagonal() * e.vectors.transpose() - A).norm(), 1e-13 * A.norm());
  for (int i = 1; i < 6; ++i) EXPECT_LE(e.values[i - 1], e.values[i]);
  EXPECT_THROW(sym_eigen(MatX::Zero(2, 3)), std::invalid_argument);
}

TEST(SolveSpd, SolvesOrSaysThatAIsNotPositive) {
  Rng rng(6);
  const MatX B = random_matrix(rng, 8, 8), A = B * B.transpose() + MatX::Identity(8, 8),
             x = random_matrix(rng, 8, 2);
  const auto solved = solve_spd(A, A * x);
  ASSERT_TRUE(solved);
  EXPECT_LT((*solved - x).norm(), 1e-12 * x.norm());
  EXPECT_FALSE(solve_spd(-A, x));
  MatX indefinite = MatX::Identity(8, 8);
  indefinite(7, 7) = -1e-3;
  EXPECT_FALSE(solve_spd(indefinite, x));
  EXPECT_FALSE(solve_spd(MatX::Constant(8, 8, std::nan("")), x));
  EXPECT_THROW(solve_spd(A, MatX::Zero(3, 1)), std::invalid_argument);
}

TEST(SolveLeastSquares, SatisfiesTheNormalEquations) {
  Rng rng(7);
  const MatX A = random_matrix(rng, 30, 5);
  const VecX b = random_matrix(rng, 30, 1);
  const auto x = solve_least_squares(A, b);
  ASSERT_TRUE(x);
  EXPECT_LT((A.transpose() * (A * *x - b)).norm(), 1e-12);
}

TEST(SolveLeastSquares, RefusesARankDeficientMatrix) {
  Rng rng(8);
  MatX A = random_matrix(rng, 30, 5);
  A.col(3) = 2 * A.col(1) - A.col(0);
  EXPECT_FALSE(solve_least_squares(A, VecX::Ones(30)));
  EXPECT_FALSE(solve_least_squares(random_matrix(rng, 3, 5), VecX::Ones(3)));
}

TEST(NearestRotation, KeepsARotationAndIsNearerThanAnyOther) {
  Rng rng(9);
  for (int i = 0; i < 50; ++i) {
    const Mat3 R = random_rotation(rng);
    EXPECT_LT((nearest_rotation(R) - R).norm(), 1e-14);
    const Mat3 A = random_matrix(rng, 3, 3);  // half of these have a negative determinant
    const Mat3 N = nearest_rotation(A);
    EXPECT_NEAR(N.determinant(), 1, 1e-13);
    EXPECT_LT((N.transpose() * N - Mat3::Identity()).norm(), 1e-13);
    for (int k = 0; k < 100; ++k) EXPECT_LE((N - A).norm(), (random_rotation(rng) - A).norm() + 1e-12);
  }
}

}  // namespace
}  // namespace plumbline
