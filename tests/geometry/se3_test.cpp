// SPDX-License-Identifier: Apache-2.0
#include "plumbline/geometry/se3.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "plumbline/core/random.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline {
namespace {

Vec6 random_twist(Rng& rng, double angle, double length_m = 1) {
  Vec6 xi;
  for (int i = 0; i < 6; ++i) xi[i] = rng.normal();
  xi.head<3>() *= angle / xi.head<3>().norm();
  xi.tail<3>() *= length_m;
  return xi;
}

// The second derivation: the exponential of the 4x4 matrix [[w]_x v; 0 0] by its series, halved and squared.
Mat4 exp_by_series(const Vec6& xi) {
  Mat4 X = Mat4::Zero();
  X.topLeftCorner<3, 3>() = skew(xi.head<3>());
  X.topRightCorner<3, 1>() = xi.tail<3>();
  X /= 64;
  Mat4 T = Mat4::Identity(), term = Mat4::Identity();
  for (int k = 1; k < 20; ++k) T += term = Mat4(term * X / k);
  for (int k = 0; k < 6; ++k) T = Mat4(T * T);
  return T;
}

// ad(xi) in the order [rotation | translation], from the bracket of the 4x4 matrices.
Mat6 little_adjoint(const Vec6& xi) {
  Mat6 ad = Mat6::Zero();
  ad.topLeftCorner<3, 3>() = ad.bottomRightCorner<3, 3>() = skew(xi.head<3>());
  ad.bottomLeftCorner<3, 3>() = skew(xi.tail<3>());
  return ad;
}

// J_l = sum ad(xi)^n / (n + 1)!, the definition that Barfoot's closed form sums up.
Mat6 left_jacobian_by_series(const Vec6& xi) {
  const Mat6 ad = little_adjoint(xi);
  Mat6 J = Mat6::Identity(), term = Mat6::Identity();
  for (int n = 1; n < 60; ++n) J += term = Mat6(term * ad / (n + 1));
  return J;
}

const std::vector<double> kAngles{1e-12,
                                  1e-7,
                                  1e-3,
                                  9.9e-3,
                                  1.1e-2,
                                  0.0999,
                                  0.1001,
                                  1,
                                  2,
                                  3,
                                  std::numbers::pi - 1e-6,
                                  std::numbers::pi - 1e-10};

TEST(Se3, ComposesInvertsAndActsLikeTheMatrix) {
  Rng rng(1);
  for (int i = 0; i < 100; ++i) {
    const SE3 T_a_b = se3_exp(random_twist(rng, 3 * rng.uniform())), T_b_c = se3_exp(random_twist(rng, 1));
    const Vec3 p_c(rng.normal(), rng.normal(), rng.normal());
    EXPECT_LT(((T_a_b * T_b_c).matrix() - T_a_b.matrix() * T_b_c.matrix()).norm(), 1e-14);
    EXPECT_LT((T_a_b * (T_b_c * p_c) - (T_a_b * T_b_c) * p_c).norm(), 1e-14);
    EXPECT_LT((T_a_b * T_a_b.inverse()).matrix().operator-(Mat4::Identity()).norm(), 2e-15);
    EXPECT_LT((T_a_b * p_c - (T_a_b.R() * p_c + T_a_b.t())).norm(), 1e-14);
    EXPECT_LT((T_a_b.matrix34() - T_a_b.matrix().topRows<3>()).norm(), 1e-300);
    EXPECT_LT((T_a_b.centre() + T_a_b.R().transpose() * T_a_b.t()).norm(), 1e-14);
    EXPECT_LT((T_a_b * T_a_b.centre()).norm(), 1e-14);  // the centre lies at the origin of a
  }
}

TEST(Se3, TheQuaternionStaysUnitThroughLongChains) {
  Rng rng(2);
  SE3 T;
  for (int i = 0; i < 10000; ++i) T = box_plus(T * se3_exp(random_twist(rng, 0.3)), random_twist(rng, 0.1));
  EXPECT_NEAR(Vec4(T.qt.data()).norm(), 1, 1e-15);
  EXPECT_LT((T.R().transpose() * T.R() - Mat3::Identity()).norm(), 1e-14);
}

TEST(Se3, IsMadeOfARotationOnly) {
  EXPECT_THROW(SE3(2 * Mat3::Identity(), Vec3::Zero()), std::invalid_argument);
  EXPECT_THROW(SE3(-Mat3::Identity(), Vec3::Zero()), std::invalid_argument);
  Rng rng(3);
  for (double angle : kAngles) {
    const Vec6 xi = random_twist(rng, angle);
    const SE3 T(so3_exp(xi.head<3>()), xi.tail<3>());
    EXPECT_LT((T.R() - so3_exp(xi.head<3>())).norm(), 4e-15);
    EXPECT_EQ(T.t(), Vec3(xi.tail<3>()));
    EXPECT_GE(T.qt[0], 0);
  }
}

TEST(Se3, ExpIsTheMatrixExponential) {
  Rng rng(4);
  for (double angle : kAngles) {
    for (int i = 0; i < 10; ++i) {
      const Vec6 xi = random_twist(rng, angle);
      EXPECT_LT((se3_exp(xi).matrix() - exp_by_series(xi)).norm(), 1e-13) << angle;
    }
  }
}

TEST(Se3, LogUndoesExpUpToPi) {
  Rng rng(5);
  for (double angle : kAngles) {
    for (int i = 0; i < 20; ++i) {
      const Vec6 xi = random_twist(rng, angle);
      EXPECT_LT((se3_log(se3_exp(xi)) - xi).norm(), 5e-14) << angle;
    }
  }
  EXPECT_EQ(se3_log(SE3()).norm(), 0);
}

TEST(Se3, AdjointMovesATwistThroughATransform) {
  Rng rng(6);
  for (int i = 0; i < 50; ++i) {
    const SE3 T = se3_exp(random_twist(rng, 2));
    const Vec6 xi = random_twist(rng, 0.5);
    const Mat4 left = T.matrix() * exp_by_series(xi) * T.inverse().matrix();
    EXPECT_LT((left - exp_by_series(se3_adjoint(T) * xi)).norm(), 1e-13);
  }
}

TEST(Se3, LeftJacobianIsTheSeriesOfAd) {
  Rng rng(7);
  for (double angle : kAngles) {
    for (int i = 0; i < 10; ++i) {
      const Vec6 xi = random_twist(rng, angle);
      EXPECT_LT((se3_left_jacobian(xi) - left_jacobian_by_series(xi)).norm(), 1e-13) << angle;
      EXPECT_LT((se3_right_jacobian(xi) - left_jacobian_by_series(-xi)).norm(), 1e-13) << angle;
      EXPECT_LT((se3_left_jacobian(xi) - se3_adjoint(se3_exp(xi)) * se3_right_jacobian(xi)).norm(), 1e-13)
          << angle;
    }
  }
  EXPECT_EQ(se3_left_jacobian(Vec6::Zero()), Mat6::Identity());
}

TEST(Se3, JacobiansAgreeWithNumericDifferentiation) {
  Rng rng(8);
  const double h = 1e-5;
  for (double angle : kAngles) {
    const Vec6 xi = random_twist(rng, angle);
    for (int k = 0; k < 6; ++k) {
      const SE3 plus = se3_exp(xi + h * Vec6::Unit(k)), minus = se3_exp(xi - h * Vec6::Unit(k));
      const Vec6 left = se3_log(plus * minus.inverse()) / (2 * h),
                 right = se3_log(minus.inverse() * plus) / (2 * h);
      // Central differences: h^2 = 1e-10 and rounding 1e-16 / h = 1e-11, a few metres long.
      EXPECT_LT((se3_left_jacobian(xi).col(k) - left).norm(), 2e-9) << angle;
      EXPECT_LT((se3_right_jacobian(xi).col(k) - right).norm(), 2e-9) << angle;
    }
  }
}

TEST(Se3, InverseJacobiansAreInverseAndTheSeriesOfBernoulli) {
  // ad / (exp(ad) - 1): 1 - ad/2 + ad^2/12 - ad^4/720 + ...
  const std::vector<double> bernoulli{1,           -0.5, 1.0 / 12,       0, -1.0 / 720,    0,
                                      1.0 / 30240, 0,    -1.0 / 1209600, 0, 1.0 / 47900160};
  Rng rng(11);
  for (double angle : kAngles) {
    for (int i = 0; i < 10; ++i) {
      const Vec6 xi = random_twist(rng, angle);
      EXPECT_LT((se3_left_jacobian(xi) * se3_left_jacobian_inverse(xi) - Mat6::Identity()).norm(), 1e-13)
          << angle;
      EXPECT_LT((se3_right_jacobian_inverse(xi) * se3_right_jacobian(xi) - Mat6::Identity()).norm(), 1e-13)
          << angle;
      if (angle > 0.11) continue;  // the next term is 691 / 1307674368000 angle^12
      Mat6 series = Mat6::Zero(), power = Mat6::Identity();
      for (double b : bernoulli) {
        series += b * power;
        power = power * little_adjoint(xi);
      }
      EXPECT_LT((se3_left_jacobian_inverse(xi) - series).norm(), 1e-13) << angle;
    }
  }
  EXPECT_THROW(se3_left_jacobian_inverse(random_twist(rng, 6.3)), std::invalid_argument);
}

TEST(Se3, InverseJacobiansMoveTheLog) {
  // log(exp(d) T) = log T + J_l^-1 d and log(T exp(d)) = log T + J_r^-1 d to first order.
  Rng rng(12);
  const double h = 1e-5;
  for (double angle : {1e-7, 0.01, 0.5, 2.0, 3.0}) {
    const Vec6 xi = random_twist(rng, angle);
    const SE3 T = se3_exp(xi);
    for (int k = 0; k < 6; ++k) {
      const Vec6 d = h * Vec6::Unit(k);
      const Vec6 left = (se3_log(se3_exp(d) * T) - se3_log(se3_exp(-d) * T)) / (2 * h);
      const Vec6 right = (se3_log(T * se3_exp(d)) - se3_log(T * se3_exp(-d))) / (2 * h);
      // Central differences: h^2 = 1e-10 times third derivatives, which near pi are some 30, and rounding
      // 1e-11.
      EXPECT_LT((se3_left_jacobian_inverse(xi).col(k) - left).norm(), 2e-8) << angle;
      EXPECT_LT((se3_right_jacobian_inverse(xi).col(k) - right).norm(), 2e-8) << angle;
    }
  }
}

TEST(Se3, AChainOfCamerasThereAndBack) {
  // T_W_C = [R' | -R't] of T_C_W, written out with plain matrices, through chains of ten frames.
  Rng rng(13);
  for (double angle : kAngles) {
    SE3 chain;
    Mat4 product = Mat4::Identity();
    std::vector<SE3> links;
    for (int i = 0; i < 10; ++i) links.push_back(se3_exp(random_twist(rng, angle)));
    for (const SE3& T : links) chain = chain * T, product = Mat4(product * T.matrix());
    EXPECT_LT((chain.matrix() - product).norm(), 1e-13) << angle;
    const Mat3 R = product.topLeftCorner<3, 3>();
    const Vec3 t = product.topRightCorner<3, 1>();
    EXPECT_LT((chain.inverse().R() - R.transpose()).norm(), 1e-13);
    EXPECT_LT((chain.inverse().t() + R.transpose() * t).norm(), 1e-12);
    EXPECT_LT((chain.centre() + R.transpose() * t).norm(), 1e-12);
    for (auto T = links.rbegin(); T != links.rend(); ++T) chain = chain * T->inverse();
    EXPECT_LT((chain.matrix() - Mat4::Identity()).norm(), 1e-12) << angle;
    EXPECT_LT(se3_log(chain).norm(), 1e-12) << angle;
  }
}

TEST(BoxPlus, StepsRotationAndTranslationApart) {
  Rng rng(9);
  for (double angle : kAngles) {
    const SE3 T = se3_exp(random_twist(rng, 2));
    const Vec6 d = random_twist(rng, angle);
    const SE3 moved = box_plus(T, d);
    EXPECT_LT((moved.R() - so3_exp(d.head<3>()) * T.R()).norm(), 1e-14) << angle;
    EXPECT_LT((moved.t() - (T.t() + d.tail<3>())).norm(), 1e-15) << angle;
  }
  EXPECT_EQ(box_plus(SE3(), Vec6::Zero()), SE3());
}

TEST(BoxMinus, UndoesBoxPlus) {
  Rng rng(10);
  for (double angle : kAngles) {
    for (int i = 0; i < 20; ++i) {
      const SE3 a = se3_exp(random_twist(rng, 3 * rng.uniform())),
                b = se3_exp(random_twist(rng, 3 * rng.uniform()));
      const Vec6 d = random_twist(rng, angle);
      EXPECT_LT((box_minus(box_plus(a, d), a) - d).norm(), 1e-14) << angle;
      EXPECT_LT((box_plus(a, box_minus(b, a)).matrix() - b.matrix()).norm(), 1e-14);
    }
  }
}

TEST(BoxPlus, JacobianOfAMovedPointIsTheOneThatIsWrittenAtIt) {
  Rng rng(11);
  const SE3 T = se3_exp(random_twist(rng, 2));
  const Vec3 p(0.3, -0.2, 0.5);
  Eigen::Matrix<double, 3, 6> J;
  J << -skew(T.R() * p), Mat3::Identity();
  const double h = 1e-5;
  for (int k = 0; k < 6; ++k) {
    const Vec3 numeric = (box_plus(T, h * Vec6::Unit(k)) * p - box_plus(T, -h * Vec6::Unit(k)) * p) / (2 * h);
    EXPECT_LT((J.col(k) - numeric).norm(), 1e-10);  // h^2 and 1e-16 / h
  }
}

}  // namespace
}  // namespace plumbline
