// SPDX-License-Identifier: Apache-2.0
// correct_matches() and triangulate_optimal() of linear/triangulate.hpp.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>
#include <opencv2/calib3d.hpp>

extern "C" {
#include <mrcal/triangulation.h>
}

#include "linear/scenes.hpp"
#include "plumbline/linear/triangulate.hpp"

namespace plumbline::test {
namespace {

struct Pair {
  Mat3 K;
  SE3 T_2_1;
  Mat3 F;
  Vec2 px1, px2;
};

Pair random_pair(Rng& rng, double sigma_px) {
  Pair q{random_k(rng, {1280, 960}),
         SE3(so3_exp(0.3 * random_direction(rng)), random_vec3(rng, -1, 1)),
         {},
         {},
         {}};
  const Vec3 p = rng.uniform(2, 6) * Vec3(rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), 1);
  const auto noise = [&]() -> Vec2 { return sigma_px * Vec2(rng.normal(), rng.normal()); };
  q.px1 = pinhole(q.K, p) + noise();
  q.px2 = pinhole(q.K, q.T_2_1 * p) + noise();
  q.F = q.K.inverse().transpose() * skew(q.T_2_1.t()) * q.T_2_1.R() * q.K.inverse();
  return q;
}

double squared_move(const Pair& q, const std::pair<Vec2, Vec2>& c) {
  return (c.first - q.px1).squaredNorm() + (c.second - q.px2).squaredNorm();
}

TEST(CorrectMatches, FulfilsTheEpipolarConstraintAndAgreesWithOpenCV) {
  Rng rng(1);
  for (int i = 0; i < 1000; ++i) {
    const Pair q = random_pair(rng, i % 2 ? 1.0 : 30.0);
    const auto c = correct_matches(rng.uniform(-5, 5) * q.F, q.px1, q.px2).value();
    const Vec3 line = q.F * c.first.homogeneous();
    EXPECT_LT(std::abs(c.second.homogeneous().dot(line)) / line.head<2>().norm(), 1e-9) << "problem " << i;
    cv::Mat F(3, 3, CV_64F), a, b;
    for (int k = 0; k < 9; ++k) F.at<double>(k / 3, k % 3) = q.F(k / 3, k % 3);
    cv::correctMatches(F, std::vector<cv::Point2d>{{q.px1.x(), q.px1.y()}},
                       std::vector<cv::Point2d>{{q.px2.x(), q.px2.y()}}, a, b);
    const std::pair<Vec2, Vec2> theirs{Vec2(a.ptr<double>()), Vec2(b.ptr<double>())};
    // Never farther than OpenCV's, which finds the same minimum for ordinary noise and misses some of it for
    // 30 px.
    EXPECT_LE(squared_move(q, c), squared_move(q, theirs) * (1 + 1e-9) + 1e-12) << "problem " << i;
    if (i % 2) EXPECT_NEAR(squared_move(q, c), squared_move(q, theirs), 1e-5 * (1 + squared_move(q, c)));
  }
}

// A second road to the minimum: the distance of a pixel to every epipolar line of a fine fan.
TEST(CorrectMatches, NoOtherEpipolarLineIsNearer) {
  Rng rng(2);
  for (int i = 0; i < 20; ++i) {
    const Pair q = random_pair(rng, 30);
    const double least = squared_move(q, correct_matches(q.F, q.px1, q.px2).value());
    const Vec3 e1 = q.K * q.T_2_1.inverse().t();
    for (int k = 0; k < 5000; ++k) {
      const double phi = std::numbers::pi * k / 5000;
      const Vec3 on_line(q.px1.x() + 1e3 * std::cos(phi), q.px1.y() + 1e3 * std::sin(phi), 1);
      const Vec3 line1 = e1.cross(on_line), line2 = q.F * on_line;
      const double d1 = line1.dot(q.px1.homogeneous()) / line1.head<2>().norm();
      const double d2 = line2.dot(q.px2.homogeneous()) / line2.head<2>().norm();
      ASSERT_GE(d1 * d1 + d2 * d2, least * (1 - 1e-9)) << "problem " << i;
    }
  }
}

TEST(CorrectMatches, LeavesExactPairsAndTakesParallelEpipolarLines) {
  Rng rng(3);
  for (int i = 0; i < 1000; ++i) {
    const Pair q = random_pair(rng, 0);
    const auto c = correct_matches(q.F, q.px1, q.px2).value();
    EXPECT_LT(squared_move(q, c), 1e-18) << "problem " << i;
  }
  // A rectified pair: both rows move to their mean.
  const auto c = correct_matches(skew(Vec3::UnitX()), Vec2(10, 20), Vec2(7, 23)).value();
  EXPECT_LT((c.first - Vec2(10, 21.5)).norm() + (c.second - Vec2(7, 21.5)).norm(), 1e-9);
}

TEST(CorrectMatches, RefusesAnEpipole) {
  Rng rng(4);
  Pair q = random_pair(rng, 0);
  q.px1 = (q.K * q.T_2_1.inverse().t()).hnormalized();
  const auto c = correct_matches(q.F, q.px1, q.px2);
  ASSERT_FALSE(c);
  EXPECT_EQ(c.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(c.error().message, ::testing::HasSubstr("view 1 is at the epipole"));
  const Mat34 P = SE3().matrix34();
  EXPECT_THAT(triangulate_optimal(P, 2 * P, Vec2(0, 0), Vec2(0, 0)).error().message,
              ::testing::HasSubstr("one centre"));
  EXPECT_EQ(correct_matches(Mat3::Zero(), q.px1, q.px2).error().code, ErrorCode::kInvalidData);
  EXPECT_EQ(correct_matches(q.F, Vec2(std::nan(""), 0), q.px2).error().code, ErrorCode::kInvalidData);
}

TEST(TriangulateOptimal, AgreesWithMrcalsLindstrom) {
  Rng rng(5);
  for (int i = 0; i < 300; ++i) {
    Pair q = random_pair(rng, 0.5);
    q.K(1, 1) = q.K(0, 0);  // Lindstrom measures on the plane z = 1
    const Vec3 p = rng.uniform(2, 6) * Vec3(rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), 1);
    q.px1 = pinhole(q.K, p) + Vec2(rng.normal(0.5), rng.normal(0.5));
    q.px2 = pinhole(q.K, q.T_2_1 * p) + Vec2(rng.normal(0.5), rng.normal(0.5));
    const Mat34 P1 = q.K * SE3().matrix34(), P2 = q.K * q.T_2_1.matrix34();
    const Vec3 ours = triangulate_optimal(P1, P2, q.px1, q.px2).value().hnormalized();
    const Mat34 pose = q.T_2_1.inverse().matrix34();
    mrcal_point3_t Rt01[4];  // rows of R, then t
    for (int r = 0; r < 3; ++r) Rt01[r] = {{pose(r, 0), pose(r, 1), pose(r, 2)}};
    Rt01[3] = {{pose(0, 3), pose(1, 3), pose(2, 3)}};
    const Vec3 a = q.K.inverse() * q.px1.homogeneous(), b = q.K.inverse() * q.px2.homogeneous();
    const mrcal_point3_t v0{{a.x(), a.y(), a.z()}}, v1{{b.x(), b.y(), b.z()}};
    const mrcal_point3_t m = mrcal_triangulate_lindstrom(nullptr, nullptr, nullptr, &v0, &v1, Rt01);
    // Its two iterations are exact to third order of the noise; a point that it refuses is 0.
    if (Vec3(m.x, m.y, m.z).norm() == 0) continue;
    EXPECT_LT((ours - Vec3(m.x, m.y, m.z)).norm(), 1e-4 * ours.norm()) << "problem " << i;
  }
}

}  // namespace
}  // namespace plumbline::test
