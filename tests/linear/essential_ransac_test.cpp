// SPDX-License-Identifier: Apache-2.0
// The robust search of linear/essential.hpp, for pinholes and for fisheyes that see behind themselves.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

#include <opencv2/calib3d.hpp>

#include "linear/two_views.hpp"
#include "plumbline/linear/essential.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

constexpr double kDegree = std::numbers::pi / 180;

Lens lens_of(const Mat3& K) { return Pinhole{K(0, 0), K(1, 1), K(0, 2), K(1, 2)}; }

double angle_between(const Vec3& a, const Vec3& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

// 190 degrees of view at 250 px from the centre.
Lens fisheye(Rng& rng) {
  KannalaBrandt4 lens;
  lens.fx = lens.fy = rng.uniform(140, 150);
  lens.cx = 320, lens.cy = 240, lens.k1 = 0.02, lens.k2 = -0.002;
  return lens;
}

struct FisheyeViews {
  Lens lens_1, lens_2;
  SE3 T_2_1;
  std::vector<Vec2> px1, px2;
  int n_behind = 0;
};

FisheyeViews fisheye_views(Rng& rng, int n, double sigma) {
  FisheyeViews s{fisheye(rng), fisheye(rng), {}, {}, {}, 0};
  s.T_2_1 = SE3(so3_exp(rng.uniform(0.1, 0.5) * random_direction(rng)), random_direction(rng));
  while (static_cast<int>(s.px1.size()) < n) {
    const Vec3 ray = random_direction(rng);
    if (ray.z() < -0.25) continue;  // up to 104 degrees off the axis
    const Vec3 p = rng.uniform(2, 8) * ray;
    const Vec3 q = s.T_2_1 * p;
    if (q.z() < -0.25 * q.norm()) continue;
    const auto a = project(s.lens_1, p), b = project(s.lens_2, q);
    if (!a || !b) continue;
    s.n_behind += p.z() < 0 || q.z() < 0;
    s.px1.push_back(noisy(rng, *a, sigma));
    s.px2.push_back(noisy(rng, *b, sigma));
  }
  return s;
}

TEST(EssentialRansac, FindsThePoseAmongOutliers) {
  Rng rng(1);
  int wrong = 0;
  for (int i = 0; i < 100; ++i) {
    TwoViews s = two_views(rng, 100, Scene::kDeep, 0.3, false);
    add_outliers(rng, 60, s);
    RansacOptions options{.inlier_px = 1.2, .seed = static_cast<std::uint64_t>(i)};
    const auto found = essential_ransac(lens_of(s.K1), lens_of(s.K2), s.px1, s.px2, options);
    ASSERT_TRUE(found) << found.error().text();
    const SE3& T = found->model.T_2_1;
    wrong += angle_between(T.t(), s.T_2_1.t()) > 3 * kDegree ||
             rotation_angle(T.R() * s.T_2_1.R().transpose()) > 1 * kDegree;
    const Mat3 F = fundamental_from_essential(found->model.E, s.K1, s.K2);
    int kept = 0;
    for (std::size_t k = 0; k < s.px1.size(); ++k) {
      // The Sampson distance of rays is that of pixels to first order in the noise.
      const double d = sampson_distance(F, s.px1[k], s.px2[k]);
      if (std::abs(d - 1.2) > 0.05) EXPECT_EQ(found->consensus.inlier[k], d <= 1.2) << d;
      kept += k < 100 && found->consensus.inlier[k];
    }
    EXPECT_GE(kept, 95);
    EXPECT_GE(found->model.n_in_front, 90);
  }
  EXPECT_LE(wrong, 2);
}

TEST(EssentialRansac, ExactWithoutNoise) {
  Rng rng(2);
  for (int i = 0; i < 100; ++i) {
    const TwoViews s = two_views(rng, 30, Scene::kDeep, 0, false);
    const auto found = essential_ransac(lens_of(s.K1), lens_of(s.K2), s.px1, s.px2, {});
    ASSERT_TRUE(found) << found.error().text();
    EXPECT_LT((found->model.T_2_1.matrix34() - s.T_2_1.matrix34()).norm(), 1e-8);
    EXPECT_EQ(found->model.n_in_front, 30);
  }
}

TEST(EssentialRansac, FisheyesSeePointsBehindThem) {
  Rng rng(3);
  int behind = 0;
  for (int i = 0; i < 60; ++i) {
    FisheyeViews s = fisheye_views(rng, 100, 0.3);
    behind += s.n_behind;
    for (int k = 0; k < 40; ++k) {
      s.px1.push_back(Vec2(320, 240) + 240 * random_direction(rng).head<2>());
      s.px2.push_back(Vec2(320, 240) + 240 * random_direction(rng).head<2>());
    }
    const auto found = essential_ransac(s.lens_1, s.lens_2, s.px1, s.px2, {.inlier_px = 1.2});
    ASSERT_TRUE(found) << found.error().text();
    EXPECT_LT(angle_between(found->model.T_2_1.t(), s.T_2_1.t()), 2 * kDegree);
    EXPECT_LT(rotation_angle(found->model.T_2_1.R() * s.T_2_1.R().transpose()), 1 * kDegree);
    EXPECT_GE(found->model.n_in_front, 95);
  }
  EXPECT_GT(behind, 500);
}

TEST(EssentialRansac, IsAsAccurateAsOpenCv) {
  Rng rng(4);
  double ours = 0, theirs = 0;
  for (int i = 0; i < 60; ++i) {
    TwoViews s = two_views(rng, 120, Scene::kDeep, 0.5);
    add_outliers(rng, 40, s);
    const auto found = essential_ransac(lens_of(s.K1), lens_of(s.K2), s.px1, s.px2, {.inlier_px = 1.5});
    ASSERT_TRUE(found) << found.error().text();
    std::vector<cv::Point2d> c1, c2;
    for (const Vec2& p : s.px1) c1.emplace_back(p.x(), p.y());
    for (const Vec2& p : s.px2) c2.emplace_back(p.x(), p.y());
    cv::Mat K = (cv::Mat_<double>(3, 3) << s.K1(0, 0), 0, s.K1(0, 2), 0, s.K1(1, 1), s.K1(1, 2), 0, 0, 1);
    cv::Mat mask, R, t;
    const cv::Mat E = cv::findEssentialMat(c1, c2, K, cv::RANSAC, 0.9999, 1.5, mask);
    cv::recoverPose(E, c1, c2, K, R, t, mask);
    ours += angle_between(found->model.T_2_1.t(), s.T_2_1.t());
    theirs += angle_between(Vec3(t.at<double>(0), t.at<double>(1), t.at<double>(2)), s.T_2_1.t());
  }
  EXPECT_LT(ours, 0.7 * theirs);  // OpenCV returns the best sample of five; ours is refitted
}

TEST(EssentialRansac, TheThreadsDoNotMatter) {
  Rng rng(5);
  TwoViews s = two_views(rng, 80, Scene::kDeep, 0.5);
  add_outliers(rng, 80, s);
  RansacOptions options{.inlier_px = 1.5, .seed = 3};
  const auto one = essential_ransac(lens_of(s.K1), lens_of(s.K2), s.px1, s.px2, options);
  ASSERT_TRUE(one) << one.error().text();
  for (const int n_threads : {2, 8}) {
    options.n_threads = n_threads;
    const auto other = essential_ransac(lens_of(s.K1), lens_of(s.K2), s.px1, s.px2, options);
    ASSERT_TRUE(other);
    EXPECT_EQ(one->model.E, other->model.E);
    EXPECT_EQ(one->consensus.inlier, other->consensus.inlier);
  }
}

TEST(EssentialRansac, RefusesATurnByName) {
  Rng rng(6);
  for (const double sigma : {0.0, 0.5}) {
    int named = 0;
    for (int i = 0; i < 60; ++i) {
      TwoViews s = two_views(rng, 100, Scene::kTurn, sigma, false);
      add_outliers(rng, i % 2 == 0 ? 0 : 40, s);
      const auto found = essential_ransac(lens_of(s.K1), lens_of(s.K2), s.px1, s.px2, {.inlier_px = 1.5});
      named += !found && found.error().message.find("the camera only turned") != std::string::npos;
    }
    EXPECT_EQ(named, 60) << sigma;
  }
}

TEST(EssentialRansac, OfAPlaneIsRightOrRefused) {
  Rng rng(7);
  for (const double sigma : {0.0, 0.3}) {
    int refused = 0, right = 0;
    for (int i = 0; i < 100; ++i) {
      TwoViews s = two_views(rng, 100, Scene::kPlane, sigma);
      add_outliers(rng, i % 2 == 0 ? 0 : 40, s);
      const auto found = essential_ransac(lens_of(s.K1), lens_of(s.K2), s.px1, s.px2, {.inlier_px = 1.5});
      if (!found) {
        ++refused;
        EXPECT_THAT(found.error().message, HasSubstr("the scene is a plane, and two motions"));
      } else {
        // A plane tells the baseline about ten times less well than a deep scene.
        right += angle_between(found->model.T_2_1.t(), s.T_2_1.t()) < 8 * kDegree;
      }
    }
    EXPECT_GE(refused + right, sigma == 0 ? 100 : 97) << sigma;
    EXPECT_GE(refused, 20);
    EXPECT_GE(right, 5);
  }
}

TEST(EssentialRansac, RefusesBadInput) {
  Rng rng(8);
  TwoViews s = two_views(rng, 10);
  const Lens lens = lens_of(s.K1);
  EXPECT_THROW((void)essential_ransac(lens, lens, std::span(s.px1).first(5), std::span(s.px2).first(5), {}),
               std::invalid_argument);
  FisheyeViews f = fisheye_views(rng, 10, 0);
  for (std::size_t i = 0; i < 6; ++i) f.px1[i] = Vec2(5000, 5000);  // outside the domain
  const auto found = essential_ransac(f.lens_1, f.lens_2, f.px1, f.px2, {});
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().message, HasSubstr("only 4 of 10 pairs"));
  s.px1[3].x() = NAN;
  EXPECT_EQ(essential_ransac(lens, lens, s.px1, s.px2, {}).error().code, ErrorCode::kInvalidData);
}

}  // namespace
}  // namespace plumbline::test
