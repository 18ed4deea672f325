// SPDX-License-Identifier: Apache-2.0
#include "plumbline/geometry/rotation.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "plumbline/core/random.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline {
namespace {

using ::testing::HasSubstr;
constexpr double kPi = std::numbers::pi;

std::vector<EulerOrder> all_orders() {
  std::vector<EulerOrder> orders;
  for (int i = 0; i < 12; ++i) orders.push_back(static_cast<EulerOrder>(i));
  return orders;
}

int axis(EulerOrder order, int i) { return to_string(order)[static_cast<std::size_t>(i)] - 'X'; }
bool same_outer_axes(EulerOrder order) { return axis(order, 0) == axis(order, 2); }

// The second derivation: Eigen's rotations about the axes, read from the order's name.
Mat3 product(EulerOrder order, const Vec3& angles) {
  Mat3 R = Mat3::Identity();
  for (int i = 0; i < 3; ++i)
    R = R * Eigen::AngleAxisd(angles[i], Vec3::Unit(axis(order, i))).toRotationMatrix();
  return R;
}

Vec3 random_axis(Rng& rng) {
  const double x = rng.normal(), y = rng.normal();
  return Vec3(x, y, rng.normal()).normalized();
}

double largest(const Mat3& M) { return M.cwiseAbs().maxCoeff(); }

TEST(Euler, TwelveOrdersHaveTheirNames) {
  EXPECT_EQ(to_string(EulerOrder::kYXZ), "YXZ");
  EXPECT_EQ(to_string(EulerOrder::kZYZ), "ZYZ");
  for (EulerOrder order : all_orders()) {
    EXPECT_EQ(parse_euler_order(to_string(order)).value(), order);
    EXPECT_NE(axis(order, 0), axis(order, 1));
    EXPECT_NE(axis(order, 1), axis(order, 2));
  }
  EXPECT_EQ(parse_euler_order("zyx").value(), EulerOrder::kZYX);
  for (const char* wrong : {"XXY", "XYW", "", "XYZX"}) {
    const auto order = parse_euler_order(wrong);
    ASSERT_FALSE(order) << wrong;
    EXPECT_EQ(order.error().code, ErrorCode::kUnsupported);
    EXPECT_THAT(order.error().message,
                HasSubstr("XYX, XYZ, XZX, XZY, YXY, YXZ, YZX, YZY, ZXY, ZXZ, ZYX, ZYZ"));
  }
}

TEST(Euler, AnglesMultiplyAsTheNameReads) {
  Rng rng(1);
  for (EulerOrder order : all_orders()) {
    for (int i = 0; i < 100; ++i) {
      const double x = rng.uniform(-7, 7), y = rng.uniform(-7, 7);
      const Vec3 angles(x, y, rng.uniform(-7, 7));
      EXPECT_LT(largest(rotation_from_euler(order, angles) - product(order, angles)), 1e-15);
    }
  }
  // Turning the camera to the right (about y, down) by a quarter turn brings what was on its right before it.
  EXPECT_LT((rotation_from_euler(EulerOrder::kYXZ, {-kPi / 2, 0, 0}) * Vec3::UnitX() - Vec3::UnitZ()).norm(),
            1e-15);
}

TEST(Euler, AnglesComeBackInTheirRanges) {
  Rng rng(2);
  for (EulerOrder order : all_orders()) {
    const double low = same_outer_axes(order) ? 0.01 : -kPi / 2 + 0.01,
                 high = same_outer_axes(order) ? kPi - 0.01 : kPi / 2 - 0.01;
    for (int i = 0; i < 1000; ++i) {
      const double first = rng.uniform(-kPi, kPi), second = rng.uniform(low, high);
      const Vec3 angles(first, second, rng.uniform(-kPi, kPi));
      const EulerAngles back = euler_from_rotation(order, product(order, angles));
      EXPECT_FALSE(back.gimbal_lock);
      // 0.01 rad from lock the outer angles feel a hundred times the rounding of R.
      EXPECT_LT((back.angles_rad - angles).cwiseAbs().maxCoeff(), 1e-12) << to_string(order);
      const double from_lock =
          same_outer_axes(order) ? std::min(second, kPi - second) : kPi / 2 - std::abs(second);
      EXPECT_NEAR(back.from_lock_rad, from_lock, 1e-14);
    }
  }
}

TEST(Euler, AgreesWithEigenWhereItCoversTheOrder) {
  // Eigen 3.4 takes the first angle in [0, pi]: the rotations are compared, and the angles where they are
  // comparable.
  Rng rng(3);
  int compared = 0;
  for (EulerOrder order : all_orders()) {
    for (int i = 0; i < 200; ++i) {
      const Mat3 R = so3_exp(rng.uniform(0, 3.1) * random_axis(rng));
      const Vec3 eigen = R.eulerAngles(axis(order, 0), axis(order, 1), axis(order, 2));
      const EulerAngles ours = euler_from_rotation(order, R);
      EXPECT_LT(largest(product(order, eigen) - product(order, ours.angles_rad)), 1e-14);
      const bool comparable = same_outer_axes(order) ? eigen[1] >= 0 : std::abs(eigen[1]) <= kPi / 2;
      if (!comparable || ours.from_lock_rad < 0.01) continue;
      EXPECT_LT((eigen - ours.angles_rad).norm(), 1e-12) << to_string(order);
      ++compared;
    }
  }
  EXPECT_GT(compared, 800);
}

TEST(Euler, GimbalLockIsNamedAndTheRotationKept) {
  Rng rng(4);
  for (EulerOrder order : all_orders()) {
    for (double lock : same_outer_axes(order) ? std::array{0.0, kPi} : std::array{-kPi / 2, kPi / 2}) {
      for (int i = 0; i < 50; ++i) {
        const double first = rng.uniform(-kPi, kPi);
        const Mat3 R = product(order, {first, lock, rng.uniform(-kPi, kPi)});
        const EulerAngles e = euler_from_rotation(order, R);
        EXPECT_TRUE(e.gimbal_lock) << to_string(order) << " " << lock;
        EXPECT_EQ(e.angles_rad[2], 0);
        EXPECT_NEAR(e.angles_rad[1], lock, 1e-15);
        EXPECT_LT(largest(product(order, e.angles_rad) - R), 1e-14);
      }
    }
  }
}

TEST(Euler, NearLockTheRotationIsKeptTo1e12) {
  Rng rng(5);
  for (EulerOrder order : all_orders()) {
    for (double lock : same_outer_axes(order) ? std::array{0.0, kPi} : std::array{-kPi / 2, kPi / 2}) {
      for (double away = 1e-17; away < 0.1; away *= 3) {
        const double inward = lock == kPi || lock == kPi / 2 ? -away : away;
        const double first = rng.uniform(-kPi, kPi);
        const Mat3 R = product(order, {first, lock + inward, rng.uniform(-kPi, kPi)});
        const EulerAngles e = euler_from_rotation(order, R);
        EXPECT_LT(largest(product(order, e.angles_rad) - R), 2e-13) << to_string(order) << " " << away;
        EXPECT_EQ(e.gimbal_lock, e.from_lock_rad < 1e-13);
        EXPECT_NEAR(e.from_lock_rad, away, 1e-15 + 1e-13 * away);
      }
    }
  }
}

TEST(Euler, SpecialRotationsOfEveryOrder) {
  // The 24 rotations of a cube, half of which lock any given order, and half turns about any axis.
  Rng rng(6);
  for (EulerOrder order : all_orders()) {
    for (int a = 0; a < 4; ++a)
      for (int b = 0; b < 4; ++b)
        for (int c = 0; c < 4; ++c) {
          const Mat3 R = product(EulerOrder::kZYX, Vec3(a, b, c) * kPi / 2);
          EXPECT_LT(largest(product(order, euler_from_rotation(order, R).angles_rad) - R), 1e-14);
        }
    for (int i = 0; i < 50; ++i) {
      const Mat3 R = so3_exp(kPi * random_axis(rng));
      EXPECT_LT(largest(product(order, euler_from_rotation(order, R).angles_rad) - R), 1e-14);
    }
  }
  EXPECT_THROW(euler_from_rotation(EulerOrder::kXYZ, 2 * Mat3::Identity()), std::invalid_argument);
  EXPECT_THROW(euler_from_rotation(EulerOrder::kXYZ, -Mat3::Identity()), std::invalid_argument);
}

const std::vector<double> kAngles{0, 1e-300, 1e-17, 1e-9, 1e-4, 1, 2, 3, 3.14, kPi - 1e-4, kPi - 1e-9, kPi};

TEST(Quaternion, RoundTripsAndHasPositiveW) {
  Rng rng(7);
  for (double angle : kAngles) {
    for (int i = 0; i < 20; ++i) {
      const Vec3 n = random_axis(rng);
      const Mat3 R = Eigen::AngleAxisd(angle, n).toRotationMatrix();
      const Vec4 q = quaternion_from_rotation(R);
      EXPECT_GE(q[0], 0);
      EXPECT_NEAR(q.norm(), 1, 1e-15);
      EXPECT_LT(largest(rotation_from_quaternion(q) - R), 2e-15) << angle;
      EXPECT_LT(largest(rotation_from_quaternion(-3 * q) - R), 2e-15) << angle;
      const Vec4 expected(std::cos(angle / 2), std::sin(angle / 2) * n.x(), std::sin(angle / 2) * n.y(),
                          std::sin(angle / 2) * n.z());
      EXPECT_LT(std::min((q - expected).norm(), (q + expected).norm()), 1e-15) << angle;
    }
  }
  EXPECT_THROW(rotation_from_quaternion(Vec4::Zero()), std::invalid_argument);
}

TEST(Quaternion, MultipliesAsRotationsDo) {
  Rng rng(8);
  for (int i = 0; i < 100; ++i) {
    const Mat3 A = so3_exp(3 * rng.uniform() * random_axis(rng)), B = so3_exp(2 * random_axis(rng));
    const Vec4 a = quaternion_from_rotation(A), b = quaternion_from_rotation(B);
    Vec4 ab;  // Hamilton: ij = k
    ab[0] = a[0] * b[0] - a.tail<3>().dot(b.tail<3>());
    ab.tail<3>() = a[0] * b.tail<3>() + b[0] * a.tail<3>() + Vec3(a.tail<3>()).cross(Vec3(b.tail<3>()));
    EXPECT_LT(largest(rotation_from_quaternion(ab) - A * B), 2e-15);
  }
}

TEST(AxisAngle, RoundTripsAlsoNear0AndPi) {
  Rng rng(9);
  for (double angle : kAngles) {
    for (int i = 0; i < 20; ++i) {
      const Vec3 n = random_axis(rng);
      const Mat3 R = Eigen::AngleAxisd(angle, n).toRotationMatrix();
      const AxisAngle back = axis_angle_from_rotation(R);
      EXPECT_NEAR(back.axis.norm(), 1, 1e-15);
      EXPECT_NEAR(back.angle_rad, angle, 1e-15) << "the angle does not lose digits near 0 or pi";
      EXPECT_LT(largest(rotation_from_axis_angle(back) - R), 3e-15) << angle;
      EXPECT_LT(largest(rotation_from_axis_angle({-2 * n, -angle}) - R), 3e-15) << "any length, any sign";
      EXPECT_LT(largest(rotation_from_axis_angle({n, angle - 4 * kPi}) - R), 1e-14) << "any turns";
      // The axis is determined as far as the angle is from 0; at pi its sign is free.
      if (angle > 1e-4 && angle < 3.1416) {
        const double apart = std::min((back.axis - n).norm(), angle == kPi ? (back.axis + n).norm() : 9);
        EXPECT_LT(apart, angle > 3.1415926 ? 2.1 : 1e-11) << angle;
      }
    }
  }
  EXPECT_EQ(axis_angle_from_rotation(Mat3::Identity()).axis, Vec3(Vec3::UnitZ()));
  EXPECT_EQ(rotation_from_axis_angle({Vec3::Zero(), 0}), Mat3(Mat3::Identity()));
  EXPECT_THROW(rotation_from_axis_angle({Vec3::Zero(), 1}), std::invalid_argument);
}

}  // namespace
}  // namespace plumbline
