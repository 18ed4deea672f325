// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/essential.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

#include "linear/two_views.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

struct Rays {
  SE3 T_2_1;
  Mat3 E;
  std::vector<Vec3> a, b;
};

// Rays from all around when wide, from a cone of 30 degrees otherwise; |t| = 1.
Rays rays(Rng& rng, int n, bool wide, Scene scene = Scene::kDeep, double sigma_rad = 0) {
  Rays s;
  s.T_2_1 = SE3(so3_exp(rng.uniform(0.05, 0.4) * random_direction(rng)), random_direction(rng));
  if (scene == Scene::kTurn) s.T_2_1 = SE3(s.T_2_1.R(), Vec3::Zero());
  s.E = essential_from_pose(s.T_2_1);
  const Vec3 normal = (random_direction(rng) + Vec3(0, 0, 2)).normalized();
  while (static_cast<int>(s.a.size()) < n) {
    Vec3 ray = random_direction(rng);
    if (!wide && ray.z() < std::cos(0.5)) continue;
    const double depth = scene == Scene::kPlane ? 5 * normal.z() / normal.dot(ray) : rng.uniform(2, 9);
    if (!(depth > 1 && depth < 50)) continue;
    const Vec3 q = (s.T_2_1 * (depth * ray)).normalized();
    s.a.push_back((ray + sigma_rad * Vec3(rng.normal(), rng.normal(), rng.normal())).normalized());
    s.b.push_back((q + sigma_rad * Vec3(rng.normal(), rng.normal(), rng.normal())).normalized());
  }
  return s;
}

std::vector<cv::Point2d> image_of_rays(const std::vector<Vec3>& rays) {
  std::vector<cv::Point2d> out;
  for (const Vec3& r : rays) out.emplace_back(r.x() / r.z(), r.y() / r.z());
  return out;
}

cv::Mat to_cv(const Mat3& M) {
  cv::Mat out(3, 3, CV_64F);
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) out.at<double>(r, c) = M(r, c);
  return out;
}

Mat3 from_cv(const cv::Mat& M) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(M.ptr<double>());
}

double angle_between(const Vec3& a, const Vec3& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

TEST(Essential5Point, OneAnswerIsTheTruthWithoutNoise) {
  Rng rng(1);
  int good = 0, lost = 0;
  constexpr int kProblems = 10000;
  for (int i = 0; i < kProblems; ++i) {
    const Rays s = rays(rng, 5, i % 2 == 0);
    const auto E = essential_5point(s.a, s.b);
    ASSERT_TRUE(E) << E.error().text();
    double nearest = 2;
    for (const Mat3& candidate : *E) nearest = std::min(nearest, projective_distance(candidate, s.E));
    good += nearest < 1e-9;
    lost += nearest > 1e-6;
  }
  EXPECT_GE(good, kProblems * 99 / 100);
  EXPECT_LE(lost, kProblems / 1000);  // a root that nearly coincides with another
}

TEST(Essential5Point, EveryAnswerIsAnEssentialMatrixThroughTheFivePairs) {
  Rng rng(2);
  for (int i = 0; i < 1000; ++i) {
    const Rays s = rays(rng, 5, i % 2 == 0, Scene::kDeep, 0.01);
    const auto E = essential_5point(s.a, s.b);
    ASSERT_TRUE(E);
    EXPECT_LE(E->size(), 10u);
    for (const Mat3& e : *E) {
      EXPECT_NEAR(e.norm(), std::sqrt(2.0), 1e-12);
      EXPECT_NEAR(e.determinant(), 0, 1e-12);
      EXPECT_LT((2 * e * e.transpose() * e - (e * e.transpose()).trace() * e).norm(), 1e-11);
      for (std::size_t k = 0; k < 5; ++k) EXPECT_NEAR(s.b[k].dot(e * s.a[k]), 0, 1e-13);
    }
  }
}

TEST(Essential5Point, HasOpenCvsAnswers) {
  Rng rng(3);
  int theirs = 0, found = 0;
  for (int i = 0; i < 300; ++i) {
    const Rays s = rays(rng, 5, false, Scene::kDeep, 0.001);
    const auto E = essential_5point(s.a, s.b);
    ASSERT_TRUE(E);
    // With five points OpenCV's least median of squares returns every answer of its solver.
    const cv::Mat M = cv::findEssentialMat(image_of_rays(s.a), image_of_rays(s.b), 1.0, {0, 0}, cv::LMEDS);
    for (int r = 0; r + 2 < M.rows; r += 3) {
      ++theirs;
      double nearest = 2;
      for (const Mat3& e : *E)
        nearest = std::min(nearest, projective_distance(e, from_cv(M.rowRange(r, r + 3))));
      found += nearest < 1e-4;
    }
  }
  EXPECT_GT(theirs, 300);
  EXPECT_GE(found, theirs * 98 / 100);  // OpenCV's polynomial loses digits and counts complex roots as real
}

TEST(Essential5Point, APlaneHasTwoAnswersThatAllItsPointsFulfil) {
  Rng rng(4);
  int two = 0;
  for (int i = 0; i < 200; ++i) {
    const Rays s = rays(rng, 12, false, Scene::kPlane);
    const auto E = essential_5point(std::span(s.a).first(5), std::span(s.b).first(5));
    ASSERT_TRUE(E) << E.error().text();
    int fulfil = 0;
    double nearest = 2;
    for (const Mat3& e : *E) {
      double worst = 0;
      for (std::size_t k = 0; k < s.a.size(); ++k) worst = std::max(worst, std::abs(s.b[k].dot(e * s.a[k])));
      fulfil += worst < 1e-9;
      nearest = std::min(nearest, projective_distance(e, s.E));
    }
    two += fulfil == 2;
    EXPECT_LT(nearest, 1e-6);
  }
  EXPECT_GE(two, 190);  // the two coincide when the baseline is along the normal
}

TEST(Essential5Point, RefusesTurnsAndBadInput) {
  Rng rng(5);
  Rays s = rays(rng, 5, false, Scene::kTurn);
  const auto turned = essential_5point(s.a, s.b);
  ASSERT_FALSE(turned);
  EXPECT_THAT(turned.error().message, HasSubstr("the camera only turned"));
  s = rays(rng, 5, false);
  s.a[1] = s.a[0], s.b[1] = s.b[0];
  EXPECT_EQ(essential_5point(s.a, s.b).error().code, ErrorCode::kDegenerate);
  s.a[1].x() = NAN;
  EXPECT_EQ(essential_5point(s.a, s.b).error().code, ErrorCode::kInvalidData);
  EXPECT_THROW((void)essential_5point(std::span(s.a).first(4), std::span(s.b).first(4)),
               std::invalid_argument);
}

TEST(Essential8Point, ExactWithoutNoise) {
  Rng rng(6);
  int good = 0, wrong = 0;
  constexpr int kProblems = 10000;
  for (int i = 0; i < kProblems; ++i) {
    const Rays s = rays(rng, 20, i % 2 == 0);
    const auto E = essential_8point(s.a, s.b);
    ASSERT_TRUE(E) << E.error().text();
    good += projective_distance(*E, s.E) < 1e-9;
    wrong += projective_distance(*E, s.E) > 1e-6;
    const Vec3 singular = Eigen::JacobiSVD<Mat3>(*E).singularValues();
    EXPECT_LT((singular - Vec3(1, 1, 0)).norm(), 1e-12);
  }
  EXPECT_GE(good, kProblems * 99 / 100);
  EXPECT_EQ(wrong, 0);
}

TEST(Essential8Point, RefusesPlanesAndTurnsByName) {
  Rng rng(7);
  for (const double sigma : {0.0, 0.0002, 0.001}) {
    for (const auto& [scene, name] : {std::pair{Scene::kPlane, "the scene is a plane"},
                                      std::pair{Scene::kTurn, "the camera only turned"}}) {
      for (const int n : {8, 12, 30, 200}) {
        int refused = 0, named = 0;
        for (int i = 0; i < 50; ++i) {
          const Rays s = rays(rng, n, false, scene, sigma);
          const auto E = essential_8point(s.a, s.b);
          if (E) continue;
          ++refused;
          named += E.error().message.find(name) != std::string::npos;
        }
        EXPECT_GE(refused, 49) << name << ", " << n << " pairs, sigma " << sigma;
        EXPECT_GE(named, 48) << name << ", " << n << " pairs, sigma " << sigma;
      }
    }
  }
}

TEST(Essential8Point, TakesScenesWithDepth) {
  Rng rng(8);
  int taken = 0;
  for (int i = 0; i < 300; ++i) {
    const Rays s = rays(rng, 30, i % 2 == 0, Scene::kDeep, 0.001);
    taken += essential_8point(s.a, s.b).has_value();
  }
  EXPECT_GE(taken, 297);
}

TEST(DecomposeEssential, HasTheTruthAndOpenCvsFour) {
  Rng rng(9);
  for (int i = 0; i < 300; ++i) {
    const Rays s = rays(rng, 1, true);
    const double scale = rng.uniform(-5, 5);
    const auto four = decompose_essential(scale * s.E);
    cv::Mat R1, R2, t;
    cv::decomposeEssentialMat(to_cv(s.E), R1, R2, t);
    int truth = 0;
    for (const SE3& T : four) {
      EXPECT_NEAR(T.t().norm(), 1, 1e-12);
      EXPECT_LT(projective_distance(essential_from_pose(T), s.E), 1e-12);
      truth += (T.matrix34() - s.T_2_1.matrix34()).norm() < 1e-9;
      EXPECT_LT(std::min((T.R() - from_cv(R1)).norm(), (T.R() - from_cv(R2)).norm()), 1e-9);
      EXPECT_NEAR(std::abs(T.t().dot(Vec3(t.at<double>(0), t.at<double>(1), t.at<double>(2)))), 1, 1e-12);
    }
    EXPECT_EQ(truth, 1);
    EXPECT_EQ(four[0].R(), four[1].R());
    EXPECT_EQ(four[2].R(), four[3].R());
    // Half a turn about the baseline apart.
    const Mat3 half = four[2].R() * four[0].R().transpose();
    EXPECT_LT((half * four[0].t() - four[0].t()).norm(), 1e-9);
    EXPECT_NEAR(half.trace(), -1, 1e-9);
  }
}

TEST(RelativePose, IsTheTruthForRaysAllAround) {
  Rng rng(10);
  for (int i = 0; i < 1000; ++i) {
    const Rays s = rays(rng, 1 + rng.index(20), true);
    const auto pose = relative_pose_from_essential(rng.uniform(-2, 2) * s.E, s.a, s.b);
    ASSERT_TRUE(pose) << pose.error().text();
    EXPECT_LT((pose->T_2_1.matrix34() - s.T_2_1.matrix34()).norm(), 1e-6);
    EXPECT_EQ(pose->n_in_front, static_cast<int>(s.a.size()));
    EXPECT_LT((pose->E - essential_from_pose(pose->T_2_1)).norm(), 1e-12);
  }
}

TEST(RelativePose, AgreesWithRecoverPose) {
  Rng rng(11);
  for (int i = 0; i < 200; ++i) {
    const Rays s = rays(rng, 40, false, Scene::kDeep, 0.001);
    std::vector<Vec3> ahead;
    for (const Vec3& b : s.b) {
      if (b.z() > 0.1) ahead.push_back(b);
    }
    if (ahead.size() < s.b.size()) continue;  // recoverPose counts z > 0 and below 50
    const auto E = essential_8point(s.a, s.b);
    ASSERT_TRUE(E) << E.error().text();
    const auto pose = relative_pose_from_essential(*E, s.a, s.b);
    ASSERT_TRUE(pose) << pose.error().text();
    cv::Mat R, t;
    const int n = cv::recoverPose(to_cv(*E), image_of_rays(s.a), image_of_rays(s.b), R, t);
    EXPECT_LT((pose->T_2_1.R() - from_cv(R)).norm(), 1e-9);
    EXPECT_LT((pose->T_2_1.t() - Vec3(t.at<double>(0), t.at<double>(1), t.at<double>(2))).norm(), 1e-9);
    EXPECT_NEAR(pose->n_in_front, n, 2);
  }
}

TEST(RelativePose, RefusesPointsAtInfinity) {
  Rng rng(12);
  const Rays s = rays(rng, 30, false, Scene::kTurn, 0.0005);
  const Mat3 E = essential_from_pose(SE3(s.T_2_1.R(), Vec3(1, 0, 0)));
  const auto pose = relative_pose_from_essential(E, s.a, s.b);
  ASSERT_FALSE(pose);
  EXPECT_EQ(pose.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(pose.error().message, HasSubstr("parallax"));
  EXPECT_THROW((void)relative_pose_from_essential(E, {}, {}), std::invalid_argument);
}

TEST(RelativePose, FarPointsDoNotVoteForTheSign) {
  Rng rng(13);
  for (int i = 0; i < 100; ++i) {
    Rays s = rays(rng, 10, false, Scene::kDeep, 0.0003);
    for (int k = 0; k < 90; ++k) {  // as good as at infinity: half of them seem to lie behind
      const Vec3 ray = s.a[static_cast<std::size_t>(k % 10)];
      const Vec3 far = s.T_2_1.R() * ray;
      s.a.push_back(ray);
      s.b.push_back((far + 0.0003 * Vec3(rng.normal(), rng.normal(), rng.normal())).normalized());
    }
    const auto pose = relative_pose_from_essential(s.E, s.a, s.b);
    ASSERT_TRUE(pose) << pose.error().text();
    EXPECT_LT(angle_between(pose->T_2_1.t(), s.T_2_1.t()), 1e-6);
  }
}

}  // namespace
}  // namespace plumbline::test
