// SPDX-License-Identifier: Apache-2.0
// White box: the null vector from A'A against the decomposition of A itself, over the range of conditions for
// which it says that it answers.
#include "linear/normal_null.hpp"

#include <gtest/gtest.h>

#include "plumbline/core/linalg.hpp"
#include "plumbline/core/random.hpp"

namespace plumbline::test {
namespace {

constexpr int N = 9;
using Matrix = Eigen::Matrix<double, N, N>;
using Vector = Eigen::Matrix<double, N, 1>;

// A tall matrix with singular values 1, ..., 1, second, last.
MatX planted(Rng& rng, int rows, double second, double last, Vector& null) {
  MatX U(rows, N), V(N, N);
  for (double& x : U.reshaped()) x = rng.normal();
  for (double& x : V.reshaped()) x = rng.normal();
  const MatX Q = MatX(Eigen::HouseholderQR<MatX>(U).householderQ()).leftCols(N);
  const MatX W = Eigen::HouseholderQR<MatX>(V).householderQ();
  Vector s = Vector::Ones();
  s[N - 2] = second, s[N - 1] = last;
  null = W.col(N - 1);
  return Q * s.asDiagonal() * W.transpose();
}

auto solve(const MatX& A) {
  return detail::null_of_normal<N>(A.transpose() * A,
                                   [&](const Vector& v) { return Vector(A.transpose() * (A * v)); });
}

double apart(const Vector& a, const Vector& b) { return std::min((a - b).norm(), (a + b).norm()); }

TEST(NormalNull, KeepsTheDigitsOfADecomposition) {
  Rng rng(1);
  for (const double second : {1.0, 1e-1, 1e-2, 1e-3, 4e-4}) {
    for (const double last : {0.0, 1e-12, 1e-4}) {
      if (last > 0.2 * second) continue;
      double worst = 0;
      for (int i = 0; i < 100; ++i) {
        Vector truth;
        const MatX A = planted(rng, 20, second, last, truth);
        const auto found = solve(A);
        ASSERT_TRUE(found) << second << " " << last;
        worst = std::max(worst, apart(found->v, null_vector(A).v));
        EXPECT_NEAR(std::abs(found->v.dot(found->next)), 0, 1e-6);
        EXPECT_LE(found->determinacy, 1.2 * second);  // over sqrt(trace), at most 3
        EXPECT_GE(found->determinacy, second / 3.2);
      }
      // Both err by the rounding of A over the gap; A'A alone would by that over its square, 1e-9 at 4e-4.
      EXPECT_LT(worst, 2e-14 / second) << second << " " << last;
    }
  }
}

TEST(NormalNull, SaysWhenItDoesNotHoldTheAnswer) {
  Rng rng(2);
  Vector truth;
  for (int i = 0; i < 100; ++i) {
    EXPECT_FALSE(solve(planted(rng, 20, 1e-5, 0, truth)));       // two null vectors but for five digits
    EXPECT_FALSE(solve(planted(rng, 20, 1e-2, 0.9e-2, truth)));  // the last two alike
  }
  EXPECT_FALSE(solve(MatX::Zero(20, N)));
  EXPECT_FALSE(solve(MatX::Constant(20, N, std::nan(""))));
}

TEST(NormalNull, TheScaleDoesNotMatter) {
  Rng rng(3);
  for (const double scale : {1e-100, 1e-8, 1e6, 1e100}) {
    Vector truth;
    const MatX A = planted(rng, 20, 0.1, 0, truth);
    const auto found = solve(scale * A);
    ASSERT_TRUE(found) << scale;
    EXPECT_LT(apart(found->v, truth), 1e-13) << scale;
  }
}

}  // namespace
}  // namespace plumbline::test
