// SPDX-License-Identifier: Apache-2.0
#include "plumbline/geometry/so3.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "plumbline/core/random.hpp"

namespace plumbline {
namespace {

Vec3 random_axis(Rng& rng) { return Vec3(rng.normal(), rng.normal(), rng.normal()).normalized(); }

// The second derivation: the matrix exponential by its definition, sum W^k / k!, halved and squared so that
// the series is short.
Mat3 exp_by_series(const Vec3& w) {
  Mat3 W = Mat3::Zero();
  W << 0, -w.z(), w.y(), w.z(), 0, -w.x(), -w.y(), w.x(), 0;
  W /= 64;
  Mat3 R = Mat3::Identity(), term = Mat3::Identity();
  for (int k = 1; k < 20; ++k) R += term = Mat3(term * W / k);
  for (int k = 0; k < 6; ++k) R = Mat3(R * R);
  return R;
}

// J_l = integral over u in [0, 1] of exp(u w), by Simpson's rule: the definition of the left Jacobian.
Mat3 left_jacobian_by_integral(const Vec3& w) {
  const int n = 200;
  Mat3 J = Mat3::Zero();
  for (int i = 0; i <= n; ++i)
    J += (i == 0 || i == n ? 1 : i % 2 == 1 ? 4 : 2) / (3.0 * n) * exp_by_series(w * i / n);
  return J;
}

// Angles on both sides of every switch in the implementation, near 0 and near pi.
const std::vector<double> kAngles{0,
                                  1e-300,
                                  1e-12,
                                  1e-9,
                                  1e-7,
                                  1e-5,
                                  1e-3,
                                  9.99e-3,
                                  1.001e-2,
                                  0.1,
                                  1,
                                  2,
                                  3,
                                  3.1415,
                                  std::numbers::pi - 1e-5,
                                  std::numbers::pi - 1e-8,
                                  std::numbers::pi - 1e-12};

TEST(So3, SkewIsTheCrossProduct) {
  const Vec3 a(1, 2, 3), b(-4, 0.5, 2);
  EXPECT_EQ(skew(a) * b, a.cross(b));
  EXPECT_EQ(skew(a).transpose(), -skew(a));
}

TEST(So3, ExpIsTheMatrixExponential) {
  Rng rng(2);
  for (double angle : kAngles) {
    for (int i = 0; i < 20; ++i) {
      const Vec3 w = angle * random_axis(rng);
      // 2e-14: the six squarings of the series multiply its own rounding by 64.
      EXPECT_LT((so3_exp(w) - exp_by_series(w)).norm(), 2e-14) << angle;
      EXPECT_LT(
          (so3_exp(w) -
           Eigen::AngleAxisd(angle, angle > 0 ? Vec3(w.normalized()) : Vec3(1, 0, 0)).toRotationMatrix())
              .norm(),
          1e-15 * 4)
          << angle;
    }
  }
  EXPECT_LT((so3_exp(Vec3(7, -9, 11)) - exp_by_series(Vec3(7, -9, 11))).norm(), 1e-13);  // several turns
}

TEST(So3, ExpIsAccurateToTheLastBitForTinyAngles) {
  const Mat3 R = so3_exp(Vec3(1e-20, -2e-20, 3e-20));  // w^2 is far below the last bit of w
  EXPECT_DOUBLE_EQ(R(2, 1), 1e-20);
  EXPECT_DOUBLE_EQ(R(0, 2), -2e-20);
  EXPECT_DOUBLE_EQ(R(1, 0), 3e-20);
}

TEST(So3, LogUndoesExpUpToPi) {
  Rng rng(3);
  for (double angle : kAngles) {
    for (int i = 0; i < 50; ++i) {
      const Vec3 w = angle * random_axis(rng);
      EXPECT_LE((so3_log(so3_exp(w)) - w).norm(), 2e-15 * angle) << angle;
    }
  }
}

TEST(So3, LogOfAHalfTurnHasAngleAndAxis) {
  Rng rng(4);
  for (int i = 0; i < 50; ++i) {
    const Vec3 axis = i < 3 ? Vec3(Vec3::Unit(i)) : random_axis(rng);
    const Mat3 R = 2 * axis * axis.transpose() - Mat3::Identity();  // exactly pi
    const Vec3 w = so3_log(R);
    EXPECT_NEAR(w.norm(), std::numbers::pi, 1e-14);
    EXPECT_NEAR(std::abs(w.normalized().dot(axis)), 1, 1e-14);  // either sign is right
  }
}

TEST(So3, LogBeyondPiComesBackTheShortWay) {
  const Vec3 w = (std::numbers::pi + 0.1) * Vec3(1, 2, 2) / 3;
  EXPECT_LT((so3_log(so3_exp(w)) + (std::numbers::pi - 0.1) * Vec3(1, 2, 2) / 3).norm(), 1e-14);
}

TEST(So3, LogRefusesWhatIsNotARotation) {
  EXPECT_THROW(so3_log(2 * Mat3::Identity()), std::invalid_argument);
  EXPECT_THROW(so3_log(-Mat3::Identity()), std::invalid_argument);  // orthogonal, but a reflection
  EXPECT_THROW(so3_log(Mat3::Constant(std::nan(""))), std::invalid_argument);
}

TEST(So3, LeftJacobianIsTheIntegralOfTheExponential) {
  Rng rng(5);
  for (double angle : kAngles) {
    for (int i = 0; i < 5; ++i) {
      const Vec3 w = angle * random_axis(rng);
      // Simpson with 200 intervals at |w| = pi is good to pi^4 / (180 * 200^4) ~ 3e-10.
      EXPECT_LT((so3_left_jacobian(w) - left_jacobian_by_integral(w)).norm(), 1e-9) << angle;
      EXPECT_LT((so3_right_jacobian(w) - left_jacobian_by_integral(-w)).norm(), 1e-9) << angle;
      // J_l = R J_r, exactly.
      EXPECT_LT((so3_left_jacobian(w) - so3_exp(w) * so3_right_jacobian(w)).norm(), 1e-14) << angle;
    }
  }
}

TEST(So3, JacobiansAgreeWithNumericDifferentiation) {
  Rng rng(6);
  const double h = 1e-5;
  for (double angle : kAngles) {
    const Vec3 w = angle * random_axis(rng);
    for (int k = 0; k < 3; ++k) {
      const Vec3 dw = h * Vec3::Unit(k);
      const Mat3 plus = so3_exp(w + dw), minus = so3_exp(w - dw);
      // Central differences are good to h^2 = 1e-10 and the rounding of log, 1e-16 / h = 1e-11.
      const Vec3 left = so3_log(plus * minus.transpose()) / (2 * h),
                 right = so3_log(minus.transpose() * plus) / (2 * h);
      EXPECT_LT((so3_left_jacobian(w).col(k) - left).norm(), 5e-10) << angle;
      EXPECT_LT((so3_right_jacobian(w).col(k) - right).norm(), 5e-10) << angle;
    }
  }
}

TEST(So3, InverseJacobiansAreInverse) {
  Rng rng(7);
  std::vector<double> angles = kAngles;
  angles.insert(angles.end(), {3.2, 5.0, 6.0});  // valid up to 2 pi
  for (double angle : angles) {
    const Vec3 w = angle * random_axis(rng);
    // The inverse grows like 1 / (2 pi - angle).
    const double tolerance = 1e-14 / (1 - angle / (2 * std::numbers::pi));
    EXPECT_LT((so3_left_jacobian(w) * so3_left_jacobian_inverse(w) - Mat3::Identity()).norm(), tolerance)
        << angle;
    EXPECT_LT((so3_right_jacobian(w) * so3_right_jacobian_inverse(w) - Mat3::Identity()).norm(), tolerance)
        << angle;
  }
  EXPECT_THROW(so3_left_jacobian_inverse(Vec3(6.3, 0, 0)), std::invalid_argument);
}

TEST(So3, RotationAngle) {
  EXPECT_NEAR(rotation_angle(so3_exp(Vec3(0, 1.25, 0))), 1.25, 1e-15);
  EXPECT_EQ(rotation_angle(Mat3::Identity()), 0);
}

}  // namespace
}  // namespace plumbline
