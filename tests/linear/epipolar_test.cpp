// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/epipolar.hpp"

#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

#include "linear/two_views.hpp"
#include "plumbline/linear/camera_matrix.hpp"

namespace plumbline::test {
namespace {

Mat34 camera(const Mat3& K, const SE3& T) { return K * T.matrix34(); }

cv::Matx33d to_cv(const Mat3& M) {
  return {M(0, 0), M(0, 1), M(0, 2), M(1, 0), M(1, 1), M(1, 2), M(2, 0), M(2, 1), M(2, 2)};
}

TEST(Epipolar, EpipolesAreTheImagesOfTheCentres) {
  Rng rng(1);
  for (int i = 0; i < 200; ++i) {
    const TwoViews s = two_views(rng, 1, Scene::kDeep, 0, false);
    const Epipoles e = epipoles(s.F);
    EXPECT_LT((s.F * e.e1).norm(), 1e-12);
    EXPECT_LT((e.e2.transpose() * s.F).norm(), 1e-12);
    EXPECT_LT(projective_distance(e.e1, Vec3(s.K1 * s.T_2_1.centre())), 1e-9);
    EXPECT_LT(projective_distance(e.e2, Vec3(s.K2 * s.T_2_1.t())), 1e-9);
  }
}

TEST(Epipolar, LinesAreOpenCvsAndGoThroughTheEpipoleAndThePartner) {
  Rng rng(2);
  const TwoViews s = two_views(rng, 50, Scene::kDeep, 0, false);
  const Epipoles e = epipoles(s.F);
  std::vector<cv::Point2d> c1, c2;
  for (const Vec2& p : s.px1) c1.emplace_back(p.x(), p.y());
  for (const Vec2& p : s.px2) c2.emplace_back(p.x(), p.y());
  std::vector<cv::Vec3d> cv2, cv1;
  cv::computeCorrespondEpilines(c1, 1, to_cv(s.F), cv2);
  cv::computeCorrespondEpilines(c2, 2, to_cv(s.F), cv1);
  for (std::size_t i = 0; i < 50; ++i) {
    const Vec3 l2 = epipolar_line_2(s.F, s.px1[i]), l1 = epipolar_line_1(s.F, s.px2[i]);
    EXPECT_NEAR(l2.head<2>().norm(), 1, 1e-14);
    EXPECT_NEAR(l2.dot(s.px2[i].homogeneous()), 0, 1e-9);
    EXPECT_NEAR(l1.dot(s.px1[i].homogeneous()), 0, 1e-9);
    EXPECT_NEAR(l2.dot(e.e2), 0, 1e-9);
    EXPECT_NEAR(l1.dot(e.e1), 0, 1e-9);
    EXPECT_LT(projective_distance(l2, Vec3(cv2[i][0], cv2[i][1], cv2[i][2])), 1e-12);
    EXPECT_LT(projective_distance(l1, Vec3(cv1[i][0], cv1[i][1], cv1[i][2])), 1e-12);
  }
  EXPECT_TRUE(epipolar_line_2(Mat3::Zero(), {1, 2}).isZero(0));
}

TEST(Epipolar, DistancesAreOpenCvsAndMeasureNoise) {
  Rng rng(3);
  double sampson = 0, symmetric = 0;
  constexpr int kScenes = 200, kPairs = 50;
  for (int i = 0; i < kScenes; ++i) {
    const TwoViews s = two_views(rng, kPairs, Scene::kDeep, 0.5);
    for (std::size_t k = 0; k < kPairs; ++k) {
      const double d = sampson_distance(s.F, s.px1[k], s.px2[k]);
      const cv::Vec3d p1(s.px1[k].x(), s.px1[k].y(), 1), p2(s.px2[k].x(), s.px2[k].y(), 1);
      const double squared = cv::sampsonDistance(p1, p2, to_cv(s.F));
      EXPECT_NEAR(d * d, squared, 1e-9 * squared);
      const double d1 = epipolar_line_1(s.F, s.px2[k]).dot(s.px1[k].homogeneous());
      const double d2 = epipolar_line_2(s.F, s.px1[k]).dot(s.px2[k].homogeneous());
      const double both = symmetric_epipolar_distance(s.F, s.px1[k], s.px2[k]);
      EXPECT_NEAR(both, std::sqrt(0.5 * (d1 * d1 + d2 * d2)), 1e-9);
      sampson += d * d, symmetric += both * both;
    }
  }
  // 10,000 pairs: the standard deviation of the root is 0.7 %.
  EXPECT_NEAR(std::sqrt(sampson / (kScenes * kPairs)), 0.5, 0.02);
  EXPECT_GE(symmetric, 2 * sampson);  // d1^2 d2^2 / (d1^2 + d2^2) is at most their mean over two
}

TEST(Epipolar, SampsonIsZeroAtBothEpipoles) {
  Mat3 F = skew(Vec3(0.5, 0.25, 1));  // a sideways and forward step: both epipoles at (0.5, 0.25)
  EXPECT_EQ(sampson_distance(F, {0.5, 0.25}, {0.5, 0.25}), 0);
  EXPECT_EQ(symmetric_epipolar_distance(F, {0.5, 0.25}, {0.5, 0.25}), 0);
}

TEST(Epipolar, FFromCamerasIsFFromThePose) {
  Rng rng(4);
  for (int i = 0; i < 200; ++i) {
    const TwoViews s = two_views(rng, 1, Scene::kDeep, 0, false);
    const SE3 T_1_world(random_rotation(rng), random_vec3(rng, -3, 3));
    const Mat34 P1 = rng.uniform(0.1, 10) * camera(s.K1, T_1_world);
    const Mat34 P2 = -rng.uniform(0.1, 10) * camera(s.K2, s.T_2_1 * T_1_world);
    const Mat3 F = fundamental_from_cameras(P1, P2);
    EXPECT_NEAR(F.norm(), 1, 1e-14);
    EXPECT_LT(projective_distance(F, s.F), 1e-10);
  }
  const Mat34 P = camera(random_k(rng, kImage), SE3(random_rotation(rng), Vec3(1, 2, 3)));
  EXPECT_TRUE(fundamental_from_cameras(P, random_rotation(rng) * P).isZero(0)) << "one centre";
}

TEST(Epipolar, CanonicalCamerasHaveTheirF) {
  Rng rng(5);
  for (int i = 0; i < 200; ++i) {
    const TwoViews s = two_views(rng, 1, Scene::kDeep, 0, false);
    const auto [P1, P2] = canonical_cameras(s.F);
    EXPECT_EQ(P1, Mat34(Mat34::Identity()));
    EXPECT_LT(projective_distance(fundamental_from_cameras(P1, P2), s.F), 1e-9);
  }
}

TEST(Epipolar, EssentialAndFundamentalAndBack) {
  Rng rng(6);
  for (int i = 0; i < 200; ++i) {
    const TwoViews s = two_views(rng, 1, Scene::kDeep, 0, false);
    const Mat3 E = essential_from_pose(s.T_2_1);
    EXPECT_NEAR(E.norm(), std::sqrt(2.0), 1e-12);
    EXPECT_NEAR((s.T_2_1 * s.p_1[0]).dot(E * s.p_1[0]), 0, 1e-12);
    EXPECT_LT(projective_distance(essential_from_fundamental(s.F, s.K1, s.K2), E), 1e-10);
    EXPECT_NEAR(essential_from_fundamental(s.F, s.K1, s.K2).norm(), std::sqrt(2.0), 1e-12);
  }
}

TEST(Epipolar, E33IsZeroWhenTheOpticalAxesMeet) {
  // E33 = [0 0 1] E [0 0 1]': the two optical axes as a pair of rays, which fulfils E when they meet.
  Rng rng(7);
  for (int i = 0; i < 200; ++i) {
    // Camera 2 anywhere, turned to the point (0, 0, depth) of the first axis and about its own axis.
    const Vec3 centre = 2 * random_direction(rng), aim = Vec3(0, 0, rng.uniform(1, 9)) - centre;
    const Mat3 to_aim = Eigen::Quaterniond::FromTwoVectors(aim, Vec3::UnitZ()).toRotationMatrix();
    const Mat3 R = so3_exp(Vec3(0, 0, rng.uniform(-3, 3))) * to_aim;
    EXPECT_NEAR(essential_from_pose(SE3(R, -R * centre))(2, 2), 0, 1e-12);
    const Mat3 off =
        so3_exp(Vec3(0.1, 0, 0)) * R;  // looks past the axis, unless it turned within the plane of both
    const double miss = std::abs((off.transpose() * Vec3::UnitZ()).dot(Vec3::UnitZ().cross(centre)));
    EXPECT_NEAR(std::abs(essential_from_pose(SE3(off, -off * centre))(2, 2)), miss, 1e-12);
  }
}

}  // namespace
}  // namespace plumbline::test
