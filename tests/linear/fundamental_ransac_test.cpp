// SPDX-License-Identifier: Apache-2.0
// The robust search of linear/fundamental.hpp, and the scenes in which RANSAC alone is wrong.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

#include "linear/two_views.hpp"
#include "plumbline/linear/fundamental.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

constexpr RansacOptions kOptions{.inlier_px = 1.5};

// A plane with `n_plane` pairs and `n_off` pairs at other depths.
TwoViews dominated(Rng& rng, int n_plane, int n_off, double sigma) {
  TwoViews s = two_views(rng, n_plane, Scene::kPlane, sigma);
  while (n_off > 0) {
    const double x = rng.uniform(50, 590);
    const Vec2 px(x, rng.uniform(50, 430));
    const Vec3 p = rng.uniform(2.5, 10) * (s.K1.inverse() * px.homogeneous());
    const Vec3 q = s.T_2_1 * p;
    if (q.z() < 1) continue;
    const Vec2 other = pinhole(s.K2, q);
    if (other.x() < 0 || other.y() < 0 || other.x() > 640 || other.y() > 480) continue;
    s.p_1.push_back(p);
    s.px1.push_back(noisy(rng, px, sigma));
    s.px2.push_back(noisy(rng, other, sigma));
    --n_off;
  }
  return s;
}

TEST(FundamentalRansac, FindsFAmongOutliers) {
  Rng rng(1);
  int wrong = 0;
  for (int i = 0; i < 200; ++i) {
    TwoViews s = two_views(rng, 120, Scene::kDeep, 0.3);
    add_outliers(rng, 80, s);
    RansacOptions options = kOptions;
    options.seed = static_cast<std::uint64_t>(i);
    const auto F = fundamental_ransac(s.px1, s.px2, options);
    ASSERT_TRUE(F) << F.error().text();
    // 120 pairs of 0.3 px leave about 0.3 sqrt(7 / 120) px; chance inliers among the 80 add to it.
    wrong += epipolar_rms(F->model, s) > 0.8;
    int kept = 0;
    for (std::size_t k = 0; k < 120; ++k) kept += F->consensus.inlier[k];
    EXPECT_GE(kept, 105);
    for (std::size_t k = 0; k < s.px1.size(); ++k) {
      EXPECT_EQ(F->consensus.inlier[k], sampson_distance(F->model, s.px1[k], s.px2[k]) <= options.inlier_px);
    }
  }
  EXPECT_LE(wrong, 2);
}

TEST(FundamentalRansac, IsAsAccurateAsOpenCv) {
  Rng rng(2);
  double ours = 0, theirs = 0;
  for (int i = 0; i < 100; ++i) {
    TwoViews s = two_views(rng, 150, Scene::kDeep, 0.5);
    add_outliers(rng, 60, s);
    const auto F = fundamental_ransac(s.px1, s.px2, kOptions);
    ASSERT_TRUE(F) << F.error().text();
    std::vector<cv::Point2d> c1, c2;
    for (const Vec2& p : s.px1) c1.emplace_back(p.x(), p.y());
    for (const Vec2& p : s.px2) c2.emplace_back(p.x(), p.y());
    const cv::Mat G = cv::findFundamentalMat(c1, c2, cv::FM_RANSAC, 1.5, 0.9999, 20000);
    ASSERT_EQ(G.rows, 3);
    const Mat3 g = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(G.ptr<double>());
    ours += epipolar_rms(F->model, s), theirs += epipolar_rms(g, s);
  }
  EXPECT_LT(ours, 1.05 * theirs);
}

TEST(FundamentalRansac, TheThreadsDoNotMatter) {
  Rng rng(3);
  TwoViews s = two_views(rng, 100, Scene::kDeep, 0.5);
  add_outliers(rng, 100, s);
  RansacOptions options{.inlier_px = 1.5, .seed = 5};
  const auto one = fundamental_ransac(s.px1, s.px2, options);
  ASSERT_TRUE(one) << one.error().text();
  for (const int n_threads : {2, 8}) {
    options.n_threads = n_threads;
    const auto other = fundamental_ransac(s.px1, s.px2, options);
    ASSERT_TRUE(other);
    EXPECT_EQ(one->model, other->model);
    EXPECT_EQ(one->consensus.inlier, other->consensus.inlier);
    EXPECT_EQ(one->consensus.n_hypotheses, other->consensus.n_hypotheses);
  }
}

TEST(FundamentalRansac, IsNotFooledByADominantPlane) {
  Rng rng(4);
  int taken = 0;
  for (int i = 0; i < 100; ++i) {
    TwoViews s = dominated(rng, 180, 20, 0.3);  // 90 % on the plane
    add_outliers(rng, 40, s);
    const auto F = fundamental_ransac(s.px1, s.px2, kOptions);
    if (!F) continue;
    ++taken;
    int kept = 0;
    for (std::size_t k = 180; k < 200; ++k) kept += F->consensus.inlier[k];
    EXPECT_GE(kept, 15) << i;
    EXPECT_LT(epipolar_rms(F->model, s), 1.5) << i;
  }
  EXPECT_GE(taken, 95);
}

TEST(FundamentalRansac, RefusesAPlaneWithOutliersByName) {
  Rng rng(5);
  for (const double sigma : {0.0, 0.5}) {
    int refused = 0, named = 0;
    for (int i = 0; i < 100; ++i) {
      TwoViews s = two_views(rng, 150, Scene::kPlane, sigma);
      add_outliers(rng, 50, s);
      const auto F = fundamental_ransac(s.px1, s.px2, kOptions);
      if (F) continue;
      ++refused;
      EXPECT_EQ(F.error().code, ErrorCode::kDegenerate);
      named += F.error().message.find("the scene is a plane") != std::string::npos;
    }
    EXPECT_EQ(refused, 100) << sigma;
    EXPECT_GE(named, 98) << sigma;
  }
}

TEST(FundamentalRansac, RefusesATurnWithOutliersByName) {
  Rng rng(6);
  for (const double sigma : {0.0, 0.5}) {
    int refused = 0, named = 0;
    for (int i = 0; i < 100; ++i) {
      TwoViews s = two_views(rng, 150, Scene::kTurn, sigma);
      add_outliers(rng, 50, s);
      const auto F = fundamental_ransac(s.px1, s.px2, kOptions);
      if (F) continue;
      ++refused;
      named += F.error().message.find("the camera only turned") != std::string::npos;
    }
    EXPECT_EQ(refused, 100) << sigma;
    EXPECT_GE(named, 98) << sigma;
  }
}

TEST(FundamentalRansac, RefusesWhatChanceGives) {
  Rng rng(7);
  int refused = 0;
  for (int i = 0; i < 50; ++i) {
    TwoViews s;
    add_outliers(rng, 60, s);
    const auto F = fundamental_ransac(s.px1, s.px2, {.inlier_px = 1.5, .max_hypotheses = 2000});
    if (F) continue;
    ++refused;
    EXPECT_THAT(F.error().message, HasSubstr("chance"));
  }
  EXPECT_GE(refused, 49);  // a risk of 1 % each
}

TEST(FundamentalRansac, RefusesBadInput) {
  Rng rng(8);
  TwoViews s = two_views(rng, 10);
  EXPECT_THROW((void)fundamental_ransac(std::span(s.px1).first(7), std::span(s.px2).first(7), {}),
               std::invalid_argument);
  EXPECT_THROW((void)fundamental_ransac(s.px1, s.px2, {.inlier_px = 0}), std::invalid_argument);
  s.px1[0].y() = NAN;
  EXPECT_EQ(fundamental_ransac(s.px1, s.px2, {}).error().code, ErrorCode::kInvalidData);
}

}  // namespace
}  // namespace plumbline::test
