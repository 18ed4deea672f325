// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/fundamental.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

#include "linear/two_views.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

std::vector<cv::Point2d> to_cv(const std::vector<Vec2>& px) {
  std::vector<cv::Point2d> out;
  for (const Vec2& p : px) out.emplace_back(p.x(), p.y());
  return out;
}

std::vector<Mat3> from_cv(const cv::Mat& F) {
  std::vector<Mat3> out;
  for (int i = 0; i + 2 < F.rows; i += 3) {
    out.push_back(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(F.ptr<double>(i)));
  }
  return out;
}

// Distance of two F in the normalised coordinates of the image, where all entries weigh alike.
double distance(const Mat3& F, const Mat3& truth) {
  Mat3 N;
  N << 200, 0, 320, 0, 200, 240, 0, 0, 1;
  return projective_distance(Mat3(N.transpose() * F * N), Mat3(N.transpose() * truth * N));
}

TEST(Fundamental8Point, ExactWithoutNoise) {
  Rng rng(1);
  int good = 0, wrong = 0;
  constexpr int kProblems = 10000;
  for (int i = 0; i < kProblems; ++i) {
    const TwoViews s = two_views(rng, 20, Scene::kDeep, 0, i % 2 == 0);
    const auto F = fundamental_8point(s.px1, s.px2);
    ASSERT_TRUE(F) << F.error().text();
    good += distance(*F, s.F) < 1e-9;
    wrong += distance(*F, s.F) > 1e-6;
  }
  EXPECT_GE(good, kProblems * 99 / 100);
  EXPECT_EQ(wrong, 0);
}

TEST(Fundamental8Point, EightPairsAreEnough) {
  Rng rng(2);
  int good = 0, answers = 0;
  for (int i = 0; i < 1000; ++i) {
    const TwoViews s = two_views(rng, 8);
    const auto F = fundamental_8point(s.px1, s.px2);
    if (!F) continue;
    ++answers;
    // Eight pairs have no redundancy: the distance grows with the condition of the sample.
    EXPECT_LT(distance(*F, s.F), 1e-5);
    good += distance(*F, s.F) < 1e-9;
  }
  EXPECT_GE(answers, 995);
  EXPECT_GE(good, 950);
}

TEST(Fundamental8Point, HasRankTwoAndItsEpipoles) {
  Rng rng(3);
  int answers = 0;
  for (int i = 0; i < 500; ++i) {
    const TwoViews s = two_views(rng, 15, Scene::kDeep, 0.3);
    const auto F = fundamental_8point(s.px1, s.px2);
    if (!F) continue;
    ++answers;
    EXPECT_NEAR(F->norm(), 1, 1e-14);
    const Epipoles e = epipoles(*F);
    EXPECT_LT((*F * e.e1).norm(), 1e-12);
    EXPECT_LT((F->transpose() * e.e2).norm(), 1e-12);
  }
  EXPECT_GE(answers, 450);  // a scene may come out too flat to tell from a plane
}

TEST(Fundamental8Point, AgreesWithOpenCv) {
  Rng rng(4);
  double ours = 0, theirs = 0;
  for (int i = 0; i < 500; ++i) {
    const TwoViews s = two_views(rng, 60, Scene::kDeep, 0.5);
    const auto F = fundamental_8point(s.px1, s.px2);
    ASSERT_TRUE(F) << F.error().text();
    const Mat3 G = from_cv(cv::findFundamentalMat(to_cv(s.px1), to_cv(s.px2), cv::FM_8POINT))[0];
    // OpenCV normalises by the mean distance and not the RMS: the same up to a few per cent of the error.
    EXPECT_LT(distance(*F, G), 0.3 * distance(*F, s.F) + 1e-6);
    ours += std::pow(epipolar_rms(*F, s), 2), theirs += std::pow(epipolar_rms(G, s), 2);
  }
  EXPECT_LT(std::sqrt(ours / theirs), 1.02);
}

TEST(Fundamental8Point, RefusesAPlaneByName) {
  Rng rng(5);  // a risk of 1 in 1000 each
  for (const double sigma : {0.0, 0.1, 0.5, 1.0}) {
    for (const int n : {8, 9, 12, 20, 60, 500}) {
      int refused = 0, named = 0;
      for (int i = 0; i < 50; ++i) {
        const TwoViews s = two_views(rng, n, Scene::kPlane, sigma);
        const auto F = fundamental_8point(s.px1, s.px2);
        if (F) continue;
        ++refused;
        EXPECT_EQ(F.error().code, ErrorCode::kDegenerate);
        named += F.error().message.find("the scene is a plane") != std::string::npos;
      }
      EXPECT_GE(refused, 49) << "sigma " << sigma << ", " << n << " pairs";
      // A small motion before a plane differs from a turn to third order only: few noisy pairs do not tell.
      EXPECT_GE(named, sigma == 0 ? 49 : n >= 60 ? 40 : 15) << "sigma " << sigma << ", " << n << " pairs";
    }
  }
}

TEST(Fundamental8Point, RefusesATurnByName) {
  Rng rng(6);
  for (const double sigma : {0.0, 0.1, 0.5, 1.0}) {
    for (const int n : {8, 9, 12, 20, 60, 500}) {
      int refused = 0, named = 0;
      for (int i = 0; i < 50; ++i) {
        const TwoViews s = two_views(rng, n, Scene::kTurn, sigma);
        const auto F = fundamental_8point(s.px1, s.px2);
        if (F) continue;
        ++refused;
        EXPECT_EQ(F.error().code, ErrorCode::kDegenerate);
        named += F.error().message.find("the camera only turned") != std::string::npos;
      }
      EXPECT_GE(refused, 49) << "sigma " << sigma << ", " << n << " pairs";
      EXPECT_GE(named, 48) << "sigma " << sigma << ", " << n << " pairs";
    }
  }
}

TEST(Fundamental8Point, RefusesAllButOneInAPlaneAlsoWithNoise) {
  Rng rng(7);
  for (const double sigma : {0.0, 0.5}) {
    int refused = 0;
    for (int i = 0; i < 100; ++i) {
      TwoViews s = two_views(rng, 30, Scene::kPlane, sigma);
      const Vec3 p(rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), 3);
      s.px1.push_back(noisy(rng, pinhole(s.K1, p), sigma));
      s.px2.push_back(noisy(rng, pinhole(s.K2, s.T_2_1 * p), sigma));
      refused += !fundamental_8point(s.px1, s.px2);
    }
    EXPECT_EQ(refused, 100) << sigma;
  }
}

TEST(Fundamental8Point, TakesScenesWithDepth) {
  Rng rng(8);
  for (const double sigma : {0.1, 0.5, 1.0}) {
    for (const int n : {20, 60}) {
      int taken = 0;
      for (int i = 0; i < 200; ++i) {
        const TwoViews s = two_views(rng, n, Scene::kDeep, sigma);
        taken += fundamental_8point(s.px1, s.px2).has_value();
      }
      EXPECT_GE(taken, 198) << "sigma " << sigma << ", " << n << " pairs";
    }
  }
}

TEST(Fundamental8Point, RefusesBadInput) {
  Rng rng(9);
  TwoViews s = two_views(rng, 10);
  EXPECT_THROW((void)fundamental_8point(std::span(s.px1).first(7), std::span(s.px2).first(7)),
               std::invalid_argument);
  EXPECT_THROW((void)fundamental_8point(s.px1, std::span(s.px2).first(9)), std::invalid_argument);
  s.px2[4].x() = NAN;
  const auto F = fundamental_8point(s.px1, s.px2);
  ASSERT_FALSE(F);
  EXPECT_EQ(F.error().code, ErrorCode::kInvalidData);
  EXPECT_THAT(F.error().message, HasSubstr("pair 4"));
  const std::vector<Vec2> one(10, Vec2(3, 4));
  EXPECT_EQ(fundamental_8point(one, one).error().code, ErrorCode::kDegenerate);
}

TEST(Fundamental7Point, OneAnswerIsTheTruthWithoutNoise) {
  Rng rng(10);
  int good = 0, wrong = 0;
  constexpr int kProblems = 10000;
  for (int i = 0; i < kProblems; ++i) {
    const TwoViews s = two_views(rng, 7, Scene::kDeep, 0, i % 2 == 0);
    const auto F = fundamental_7point(s.px1, s.px2);
    ASSERT_TRUE(F) << F.error().text();
    EXPECT_TRUE(F->size() == 1 || F->size() == 3) << F->size();
    double nearest = 2;
    for (const Mat3& candidate : *F) {
      nearest = std::min(nearest, distance(candidate, s.F));
      for (std::size_t k = 0; k < 7; ++k) {
        EXPECT_LT(sampson_distance(candidate, s.px1[k], s.px2[k]), 1e-6);
      }
    }
    good += nearest < 1e-9;
    wrong += nearest > 1e-4;
  }
  EXPECT_GE(good, kProblems * 99 / 100);
  EXPECT_LE(wrong, 1);  // the true answer may be one of two that nearly coincide
}

TEST(Fundamental7Point, HasOpenCvsAnswers) {
  Rng rng(11);
  int same_number = 0;
  for (int i = 0; i < 500; ++i) {
    const TwoViews s = two_views(rng, 7, Scene::kDeep, 1);
    const auto F = fundamental_7point(s.px1, s.px2);
    ASSERT_TRUE(F);
    const auto G = from_cv(cv::findFundamentalMat(to_cv(s.px1), to_cv(s.px2), cv::FM_7POINT));
    same_number += F->size() == G.size();
    for (const Mat3& g : G) {
      double nearest = 2;
      for (const Mat3& f : *F) nearest = std::min(nearest, distance(f, g));
      EXPECT_LT(nearest, 1e-4);  // OpenCV does not normalise the pixels
    }
  }
  EXPECT_GE(same_number, 498);
}

TEST(Fundamental7Point, RefusesAPlane) {
  Rng rng(12);
  for (const Scene scene : {Scene::kPlane, Scene::kTurn}) {
    const TwoViews s = two_views(rng, 7, scene);
    const auto F = fundamental_7point(s.px1, s.px2);
    ASSERT_FALSE(F);
    EXPECT_EQ(F.error().code, ErrorCode::kDegenerate);
  }
  const TwoViews s = two_views(rng, 8);
  EXPECT_THROW((void)fundamental_7point(s.px1, s.px2), std::invalid_argument);
}

}  // namespace
}  // namespace plumbline::test
