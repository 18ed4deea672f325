// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/plane_motion.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <opencv2/calib3d.hpp>

#include "linear/scenes.hpp"
#include "plumbline/linear/homography.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

struct Scene {
  Mat3 K1, K2, H;
  PlaneMotion truth;
  std::vector<Vec2> px1;
};

// A plane before camera 1, tilted by less than 60 degrees, and a second camera on the same side that sees it.
Scene random_scene(Rng& rng) {
  for (;;) {
    Scene s{random_k(rng, {640, 480}), random_k(rng, {640, 480}), {}, {}, {}};
    s.truth.normal_1 = so3_exp(rng.uniform(0, 1) * random_direction(rng)) * Vec3::UnitZ();
    if (s.truth.normal_1.z() < 0.5) continue;
    s.truth.R = so3_exp(rng.uniform(0, 0.5) * random_direction(rng));
    s.truth.t_over_d = rng.uniform(0.05, 0.6) * random_direction(rng);
    const Mat3 metric = s.truth.R + s.truth.t_over_d * s.truth.normal_1.transpose();
    if (metric.determinant() < 0.1) continue;
    const double scale = std::pow(10, rng.uniform(-3, 3)) * (rng.uniform() < 0.5 ? -1 : 1);
    s.H = scale * s.K2 * metric * s.K1.inverse();
    bool seen = true;
    for (const Vec2& px : {Vec2(0, 0), Vec2(639, 0), Vec2(639, 479), Vec2(0, 479), Vec2(320, 240)}) {
      const Vec3 ray = s.K1.inverse() * px.homogeneous();
      seen = seen && s.truth.normal_1.dot(ray) > 0.1 && (metric * ray).z() > 0.1;
      s.px1.push_back(px);
    }
    if (seen) return s;
  }
}

double distance(const PlaneMotion& a, const PlaneMotion& b) {
  return (a.R - b.R).norm() + (a.t_over_d - b.t_over_d).norm() + (a.normal_1 - b.normal_1).norm();
}

double nearest(std::span<const PlaneMotion> motions, const PlaneMotion& truth) {
  double least = std::numeric_limits<double>::infinity();
  for (const PlaneMotion& m : motions) least = std::min(least, distance(m, truth));
  return least;
}

TEST(PlaneMotions, TenThousandProblemsWithoutNoise) {
  Rng rng(1);
  int good = 0, wrong = 0;
  for (int i = 0; i < 10000; ++i) {
    const Scene s = random_scene(rng);
    const auto motions = plane_motions(s.H, s.K1, s.K2);
    ASSERT_TRUE(motions) << motions.error().text();
    const auto visible = visible_plane_motions(*motions, s.K1, s.px1);
    EXPECT_GE(visible.size(), 1u);
    EXPECT_LE(visible.size(), 2u);
    // t/d of 0.05 amplifies the rounding of H by 20 to 400 and, when t is along n, by its square root.
    const double error = nearest(visible, s.truth);
    good += error < 1e-9;
    wrong += error > 1e-4;
    for (const PlaneMotion& m : *motions) {
      EXPECT_NEAR(m.normal_1.norm(), 1, 1e-12);
      EXPECT_NEAR(m.R.determinant(), 1, 1e-12);
      EXPECT_LT(projective_distance(s.K2 * (m.R + m.t_over_d * m.normal_1.transpose()) * s.K1.inverse(), s.H),
                1e-9);
    }
  }
  EXPECT_GE(good, 9900);
  EXPECT_EQ(wrong, 0);
}

TEST(PlaneMotions, AgreeWithOpenCv) {
  Rng rng(2);
  for (int i = 0; i < 300; ++i) {
    Scene s = random_scene(rng);
    s.K2 = s.K1;  // OpenCV takes one camera
    const Mat3 metric = s.truth.R + s.truth.t_over_d * s.truth.normal_1.transpose();
    s.H = s.K1 * metric * s.K1.inverse();
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> H = s.H, K = s.K1;
    std::vector<cv::Mat> R, t, n;
    cv::decomposeHomographyMat(cv::Mat(3, 3, CV_64F, H.data()), cv::Mat(3, 3, CV_64F, K.data()), R, t, n);
    const auto ours = plane_motions(s.H, s.K1, s.K1).value();
    ASSERT_EQ(R.size(), 4u);
    ASSERT_EQ(ours.size(), 4u);
    for (std::size_t k = 0; k < 4; ++k) {
      using Row = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
      const PlaneMotion cv{Row(R[k].ptr<double>()), Vec3(t[k].ptr<double>()), Vec3(n[k].ptr<double>())};
      // OpenCV works with square roots of differences of products: 1e-8 where those nearly cancel.
      EXPECT_LT(nearest(ours, cv), 1e-6) << "problem " << i;
    }
  }
}

TEST(PlaneMotions, TwoAnswersWhenTheCameraMovesAlongTheNormal) {
  Rng rng(3);
  for (int i = 0; i < 300; ++i) {
    Scene s = random_scene(rng);
    const double along = rng.uniform(0.1, 0.5) * (i % 2 ? 1 : -1);
    s.truth.t_over_d = along * (s.truth.R * s.truth.normal_1);
    s.H = s.K2 * (s.truth.R + s.truth.t_over_d * s.truth.normal_1.transpose()) * s.K1.inverse();
    const auto motions = plane_motions(s.H, s.K1, s.K2).value();
    // K^-1 H K leaves 1e-14 of difference, whose square root is the least that can be told.
    EXPECT_LT(nearest(motions, s.truth), 3e-6);
    const auto visible = visible_plane_motions(motions, s.K1, s.px1);
    ASSERT_GE(visible.size(), 1u);
    for (const PlaneMotion& m : visible) EXPECT_LT(distance(m, s.truth), 3e-6);
  }
  // Exact numbers: the two coincide and are given once.
  const Mat3 H = Vec3(1, 1, 0.75).asDiagonal();  // a quarter of the way to a frontal plane
  const auto motions = plane_motions(H, Mat3::Identity(), Mat3::Identity()).value();
  ASSERT_EQ(motions.size(), 2u);
  EXPECT_LT(nearest(motions, {Mat3::Identity(), Vec3(0, 0, -0.25), Vec3::UnitZ()}), 1e-15);
}

TEST(PlaneMotions, OfNoisyPointsAreNearTheTruth) {
  Rng rng(4);
  double sum = 0;
  for (int i = 0; i < 200; ++i) {
    const Scene s = random_scene(rng);
    std::vector<Vec2> a, b;
    for (int k = 0; k < 100; ++k) {
      const double x = rng.uniform(0, 639);
      a.emplace_back(x, rng.uniform(0, 479));
      b.push_back((s.H * a.back().homogeneous()).hnormalized() + Vec2(rng.normal(0.2), 0));
      b.back().y() += rng.normal(0.2);
    }
    const auto visible =
        visible_plane_motions(plane_motions(homography(a, b).value(), s.K1, s.K2).value(), s.K1, a);
    ASSERT_GE(visible.size(), 1u);
    sum += std::min(nearest(visible, s.truth), 1.0) / 200;
  }
  // 0.2 px over 640 px is 3e-4 of the image; t/d down to 0.05 amplifies it by up to 20 in the normal.
  EXPECT_LT(sum, 0.02);
}

TEST(PlaneMotions, RefusesAPureRotationASingularMatrixAndNan) {
  Rng rng(5);
  const Mat3 K = random_k(rng, {640, 480});
  const Mat3 R = random_rotation(rng);
  const auto rotation = plane_motions(K * R * K.inverse(), K, K);
  ASSERT_FALSE(rotation);
  EXPECT_EQ(rotation.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(rotation.error().message, HasSubstr("pure rotation"));
  const auto singular = plane_motions(Vec3(1, 1, 0).asDiagonal(), Mat3::Identity(), Mat3::Identity());
  ASSERT_FALSE(singular);
  EXPECT_EQ(singular.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(singular.error().message, HasSubstr("singular"));
  EXPECT_EQ(plane_motions(Mat3::Zero(), K, K).error().code, ErrorCode::kDegenerate);
  EXPECT_EQ(plane_motions(Mat3::Constant(std::nan("")), K, K).error().code, ErrorCode::kInvalidData);
  EXPECT_THROW((void)visible_plane_motions({}, K, {}), std::invalid_argument);
}

}  // namespace
}  // namespace plumbline::test
