// SPDX-License-Identifier: Apache-2.0
// White box: the solver that the refine_* functions of one pose, point or matrix share, against Ceres' own
// small solver.
#include "refine/small_solve.hpp"

#include <ceres/tiny_solver.h>
#include <gtest/gtest.h>

#include "plumbline/core/random.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline::test {
namespace {

using detail::NormalEquations;
using detail::solve_small;

// a exp(b x) + c through noisy points.
struct Curve {
  using Scalar = double;
  enum { NUM_RESIDUALS = Eigen::Dynamic, NUM_PARAMETERS = 3 };
  std::vector<Vec2> points;

  int NumResiduals() const { return static_cast<int>(points.size()); }
  bool operator()(const double* k, double* r, double* J) const {
    const int n = NumResiduals();
    for (int i = 0; i < n; ++i) {
      const double e = std::exp(k[1] * points[i].x());
      r[i] = k[0] * e + k[2] - points[i].y();
      if (J) J[i] = e, J[n + i] = k[0] * points[i].x() * e, J[2 * n + i] = 1;
    }
    return true;
  }
  bool operator()(const Vec3& k, NormalEquations<3>& out) const {
    for (const Vec2& p : points) {
      const double e = std::exp(k[1] * p.x());
      out.add<1>(Eigen::Matrix<double, 1, 1>(k[0] * e + k[2] - p.y()),
                 Eigen::RowVector3d(e, k[0] * p.x() * e, 1));
    }
    return true;
  }
};

const auto kPlus = [](const Vec3& a, const Vec3& d) { return Vec3(a + d); };

TEST(SmallSolve, ReachesCeresOptimum) {
  Rng rng(1);
  for (int trial = 0; trial < 50; ++trial) {
    Curve curve;
    const double a = rng.uniform(0.5, 3), b = rng.uniform(0.3, 1.2), c = rng.uniform(-1, 1);
    for (int i = 0; i < 40; ++i) {
      const double x = rng.uniform(-2, 2);
      curve.points.emplace_back(x, a * std::exp(b * x) + c + rng.normal(0.05));
    }
    const auto ours = solve_small<3>(Vec3(1.5, 0.7, 0), curve, kPlus);
    ASSERT_TRUE(ours);
    EXPECT_TRUE(ours->converged);
    ceres::TinySolver<Curve> ceres;
    ceres.options.max_num_iterations = 500;
    ceres.options.function_tolerance = 0;
    ceres.options.gradient_tolerance = 1e-13;
    Vec3 k(1.5, 0.7, 0);
    ceres.Solve(curve, &k);
    EXPECT_NEAR(ours->equations.cost, ceres.summary.final_cost, 1e-12 * ceres.summary.final_cost);
    EXPECT_LT((ours->state - k).norm(), 1e-6);  // sqrt of the relative cost that doubles resolve
  }
}

TEST(SmallSolve, IsExactWithoutNoise) {
  Curve curve;
  for (int i = 0; i < 10; ++i) curve.points.emplace_back(0.2 * i, 2 * std::exp(0.14 * i) - 0.5);
  const auto s = solve_small<3>(Vec3(1, 0.1, 0), curve, kPlus);
  ASSERT_TRUE(s);
  EXPECT_TRUE(s->converged);
  EXPECT_LT((s->state - Vec3(2, 0.7, -0.5)).norm(), 1e-10);
}

// Rosenbrock's valley, twice as steep.
TEST(SmallSolve, FollowsACurvedValley) {
  const auto s = solve_small<2>(
      Vec2(-1.2, 1),
      [](const Vec2& x, NormalEquations<2>& out) {
        Mat2 J;
        J << -40 * x.x(), 20, -1, 0;
        out.add<2>(Vec2(20 * (x.y() - x.x() * x.x()), 1 - x.x()), J);
        return true;
      },
      [](const Vec2& a, const Vec2& d) { return Vec2(a + d); });
  ASSERT_TRUE(s);
  EXPECT_TRUE(s->converged);
  EXPECT_LT((s->state - Vec2(1, 1)).norm(), 1e-9);
}

// The rotation that takes points to noisy images of themselves has a closed form: a second derivation.
TEST(SmallSolve, MovesOnAManifold) {
  Rng rng(2);
  for (int trial = 0; trial < 50; ++trial) {
    const Mat3 truth = so3_exp(Vec3(rng.normal(), rng.normal(), rng.normal()));
    std::vector<Vec3> a, b;
    Mat3 moment = Mat3::Zero();
    for (int i = 0; i < 20; ++i) {
      a.emplace_back(rng.normal(), rng.normal(), rng.normal());
      b.push_back(truth * a.back() + 0.05 * Vec3(rng.normal(), rng.normal(), rng.normal()));
      moment += b.back() * a.back().transpose();
    }
    const auto s = solve_small<3>(
        truth,
        [&](const Mat3& R, NormalEquations<3>& out) {
          for (std::size_t i = 0; i < a.size(); ++i) out.add<3>(R * a[i] - b[i], -skew(R * a[i]));
          return true;
        },
        [](const Mat3& R, const Vec3& d) { return Mat3(so3_exp(d) * R); });
    ASSERT_TRUE(s);
    const Eigen::JacobiSVD<Mat3> svd(moment, Eigen::ComputeFullU | Eigen::ComputeFullV);
    EXPECT_LT((s->state - svd.matrixU() * svd.matrixV().transpose()).norm(), 1e-8);
  }
}

// log(x) at its minimum of (log x - 1)^2 from a start whose Gauss-Newton step leaves the domain x > 0.
TEST(SmallSolve, RejectsStepsOutOfTheDomain) {
  using One = Eigen::Matrix<double, 1, 1>;
  const auto evaluate = [](double x, NormalEquations<1>& out) {
    if (!(x > 0)) return false;
    out.add<1>(One(std::log(x) - 1), One(1 / x));
    return true;
  };
  const auto plus = [](double x, const One& d) { return x + d[0]; };
  const auto s = solve_small<1>(50.0, evaluate, plus);
  ASSERT_TRUE(s);
  EXPECT_TRUE(s->converged);
  EXPECT_NEAR(s->state, std::exp(1.0), 1e-9);
  EXPECT_FALSE(solve_small<1>(-1.0, evaluate, plus));
}

TEST(SmallSolve, InvertsNormalEquationsOfUnlikeUnits) {
  Rng rng(3);
  Eigen::Matrix<double, 12, 6> J;
  for (double& x : J.reshaped()) x = rng.normal();
  Vec6 units;
  units << 1e5, 1e-4, 1, 1e3, 1e-6, 10;
  const Mat6 A = (J * units.asDiagonal()).transpose() * (J * units.asDiagonal());
  const auto inverse = detail::spd_inverse<6>(A);
  ASSERT_TRUE(inverse);
  const Mat6 unit = units.asDiagonal() * (*inverse * A) * units.cwiseInverse().asDiagonal();
  EXPECT_LT((unit - Mat6::Identity()).norm(), 1e-9);
  EXPECT_FALSE(detail::spd_inverse<2>(Mat2::Ones()));
  EXPECT_FALSE(detail::spd_inverse<2>(Mat2::Zero()));
}

}  // namespace
}  // namespace plumbline::test
