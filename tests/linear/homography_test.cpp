// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/homography.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

#include "linear/scenes.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

// A board seen by a pinhole: a homography with moderate perspective.
Mat3 random_homography(Rng& rng) {
  const Mat3 K = random_k(rng, {640, 480});
  const SE3 T = random_board_pose(rng, rng.uniform(0.4, 1.5), rng.uniform(0, 0.9));
  Mat3 H = K * T.matrix34()(Eigen::all, {0, 1, 3});
  return H / H.norm();
}

std::vector<Vec2> random_points(Rng& rng, int n) {
  std::vector<Vec2> a;
  while (static_cast<int>(a.size()) < n) {
    const double x = rng.uniform(-0.2, 0.2);
    a.emplace_back(x, rng.uniform(-0.2, 0.2));
  }
  return a;
}

std::vector<Vec2> map_points(const Mat3& H, const std::vector<Vec2>& a, Rng* rng = nullptr,
                             double sigma = 0) {
  std::vector<Vec2> b;
  for (const Vec2& p : a) {
    b.push_back((H * p.homogeneous()).hnormalized());
    if (rng) {
      b.back().x() += rng->normal(sigma);
      b.back().y() += rng->normal(sigma);
    }
  }
  return b;
}

double transfer_rms(const Mat3& H, const std::vector<Vec2>& a, const std::vector<Vec2>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    sum += ((H * a[i].homogeneous()).hnormalized() - b[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(a.size()));
}

Mat3 opencv_homography(const std::vector<Vec2>& a, const std::vector<Vec2>& b) {
  std::vector<cv::Point2d> ca, cb;
  for (const Vec2& p : a) ca.emplace_back(p.x(), p.y());
  for (const Vec2& p : b) cb.emplace_back(p.x(), p.y());
  const cv::Mat H = cv::findHomography(ca, cb, 0);
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(H.ptr<double>());
}

TEST(Homography, ExactWithoutNoise) {
  Rng rng(1);
  for (int i = 0; i < 300; ++i) {
    const Mat3 truth = random_homography(rng);
    const auto a = grid(2 + rng.index(8), 2 + rng.index(6), 0.03);
    const auto H = homography(a, map_points(truth, a));
    ASSERT_TRUE(H) << H.error().text();
    EXPECT_LT((*H - truth).norm(), 1e-9) << "problem " << i;  // the sign too: truth has w > 0
    EXPECT_NEAR(H->norm(), 1, 1e-14);
  }
}

TEST(Homography, TenThousandProblemsWithoutNoise) {
  Rng rng(8);
  int good = 0, wrong = 0;
  for (int i = 0; i < 10000; ++i) {
    const Mat3 truth = random_homography(rng);
    const auto a = random_points(rng, 8 + i % 20);
    const auto H = homography(a, map_points(truth, a));
    if (!H) continue;
    const double error = (*H - truth).norm();
    good += error < 1e-9;
    wrong += error > 1e-6;
  }
  EXPECT_GE(good, 9900);
  EXPECT_EQ(wrong, 0);
}

TEST(Homography, TheSignMakesTheFirstPointPositive) {
  Rng rng(2);
  for (int i = 0; i < 50; ++i) {
    // Points on both sides of the horizon of H.
    const Mat3 truth =
        (Mat3() << 1, 0.2, 3, -0.1, 1.2, 1, rng.uniform(1, 4), rng.uniform(1, 4), 0.3).finished();
    const auto a = random_points(rng, 12);
    const auto H = homography(a, map_points(truth, a));
    ASSERT_TRUE(H) << H.error().text();
    EXPECT_LT(projective_distance(*H, truth), 1e-8);  // points near the horizon are far away in b
    EXPECT_GT(H->row(2).dot(a[0].homogeneous()), 0);
  }
}

TEST(Homography, DoesNotDependOnUnitsOrOrigin) {
  Rng rng(3);
  const Mat3 truth = random_homography(rng);
  const auto a = grid(9, 6, 0.025);
  const auto b = map_points(truth, a, &rng, 0.3);
  const Mat3 H = homography(a, b).value();
  std::vector<Vec2> a_mm;
  for (const Vec2& p : a) a_mm.push_back(1000 * p + Vec2(5000, -300));
  const Mat3 H_mm = homography(a_mm, b).value();
  Mat3 mm;
  mm << 1000, 0, 5000, 0, 1000, -300, 0, 0, 1;
  EXPECT_LT(projective_distance(H_mm * mm, H), 1e-10);
}

TEST(Homography, NoiseCostsWhatTheoryAllowsAndScales) {
  // The transfer error left at n points by an efficient estimator of 8 parameters is sigma sqrt(2 (1 - 8 /
  // 2n)); DLT minimises an algebraic error, so it may lose a few per cent on it and can never beat it.
  Rng rng(4);
  const auto a = grid(9, 6, 0.025);
  const double n = static_cast<double>(a.size()), expected = std::sqrt(2 * (1 - 8 / (2 * n)));
  double last = 0;
  for (const double sigma : {0.01, 0.1, 1.0}) {
    double squared = 0, squared_cv = 0;
    double error = 0;
    for (int i = 0; i < 300; ++i) {
      const Mat3 truth = random_homography(rng);
      const auto b = map_points(truth, a, &rng, sigma);
      const Mat3 H = homography(a, b).value();
      squared += std::pow(transfer_rms(H, a, b) / sigma, 2);
      squared_cv += std::pow(transfer_rms(opencv_homography(a, b), a, b) / sigma, 2);
      error += transfer_rms(H, a, map_points(truth, a)) / 300;
    }
    // 300 problems of 100 degrees of freedom each: the standard deviation of this mean is 0.0056.
    EXPECT_NEAR(std::sqrt(squared / 300), expected, 0.02) << "sigma " << sigma;
    // OpenCV ends with Levenberg-Marquardt on the transfer error.
    EXPECT_NEAR(std::sqrt(squared / squared_cv), 1.0, 0.01);
    if (last > 0) {
      EXPECT_NEAR(error / last, 10, 1) << "ten times the noise gives ten times the error";
    }
    last = error;
  }
}

TEST(Homography, RefusesPointsOnALine) {
  std::vector<Vec2> line, square = grid(3, 2, 1);
  for (int i = 0; i < 6; ++i) line.emplace_back(0.1 * i, 0.3 - 0.2 * i);
  for (const auto& [a, b, word] :
       {std::tuple{line, square, "first plane"}, std::tuple{square, line, "second plane"}}) {
    const auto H = homography(a, b);
    ASSERT_FALSE(H);
    EXPECT_EQ(H.error().code, ErrorCode::kDegenerate);
    EXPECT_THAT(H.error().message, HasSubstr("lie on a line"));
    EXPECT_THAT(H.error().message, HasSubstr(word));
  }
}

TEST(Homography, RefusesThreeOfFourOnALineAlsoWithNoise) {
  Rng rng(5);
  for (const double sigma : {0.0, 0.5}) {
    for (int i = 0; i < 50; ++i) {
      const double s = rng.uniform(0.2, 0.8);
      const std::vector<Vec2> a{{0, 0}, {s, 0.5 * s}, {1, 0.5}, {0.1, 0.9}};
      const auto b = map_points(random_homography(rng), a, &rng, sigma);
      const auto H = homography(a, b);
      ASSERT_FALSE(H) << "sigma " << sigma;
      EXPECT_EQ(H.error().code, ErrorCode::kDegenerate);
      EXPECT_THAT(H.error().message, HasSubstr("all but one of the 4 points"));
    }
  }
}

TEST(Homography, RefusesDoublePoints) {
  const std::vector<Vec2> a{{0, 0}, {0, 0}, {1, 0}, {1, 0}, {0, 1}, {0, 1}};  // three places
  const auto H = homography(a, a);
  ASSERT_FALSE(H);
  EXPECT_EQ(H.error().code, ErrorCode::kDegenerate);
  const std::vector<Vec2> same(5, Vec2(1, 2));
  EXPECT_EQ(homography(same, same).error().code, ErrorCode::kDegenerate);
}

TEST(Homography, CallerBugsThrowAndNanIsInvalidData) {
  const auto a = grid(2, 2, 1);
  EXPECT_THROW((void)homography(std::span(a).first(3), std::span(a).first(3)), std::invalid_argument);
  EXPECT_THROW((void)homography(a, std::span(a).first(3)), std::invalid_argument);
  auto b = a;
  b[2].y() = std::nan("");
  EXPECT_EQ(homography(a, b).error().code, ErrorCode::kInvalidData);
}

TEST(HomographyToRays, ExactForAnyDirectionOfTheBoard) {
  Rng rng(6);
  for (int i = 0; i < 300; ++i) {
    // A board anywhere around the camera, also behind it, so near that its rays span up to 120 degrees.
    Mat3 R = random_rotation(rng);
    const Vec3 t = rng.uniform(0.15, 1.0) * random_direction(rng);
    if (std::abs(R.col(2).dot(t.normalized())) < 0.2) continue;  // seen edge-on
    const Mat3 truth = (Mat3() << R.col(0), R.col(1), t).finished();
    const auto a = grid(2 + rng.index(8), 2 + rng.index(6), 0.03);
    std::vector<Vec3> rays;
    for (const Vec2& p : a) rays.push_back((truth * p.homogeneous()).normalized());
    const auto H = homography_to_rays(a, rays);
    ASSERT_TRUE(H) << H.error().text();
    EXPECT_LT((*H - truth / truth.norm()).norm(), 1e-9) << "problem " << i;  // the sign too: positive factors
  }
}

TEST(HomographyToRays, AgreesWithPixelsForANarrowBundle) {
  Rng rng(7);
  const auto a = grid(9, 6, 0.01);
  for (int i = 0; i < 50; ++i) {
    const Mat3 K = (Mat3() << 900, 0, 320, 0, 900, 240, 0, 0, 1).finished();
    const SE3 T = random_board_pose(rng, 2.0, 0.5);
    const Mat3 H_true = K * T.matrix34()(Eigen::all, {0, 1, 3});
    const auto b = map_points(H_true, a, &rng, 0.1);
    std::vector<Vec3> rays;
    for (const Vec2& px : b) rays.push_back((K.inverse() * px.homogeneous()).normalized());
    const Mat3 from_rays = K * homography_to_rays(a, rays).value(), from_px = homography(a, b).value();
    // The two weigh the same errors slightly differently: both are as near to the truth as the noise allows.
    EXPECT_NEAR(transfer_rms(from_rays, a, b) / transfer_rms(from_px, a, b), 1, 1e-3);
  }
}

TEST(HomographyToRays, RefusesABoardSeenEdgeOnAndAThinBundle) {
  const auto a = grid(4, 3, 0.1);
  std::vector<Vec3> rays;
  for (const Vec2& p : a) rays.push_back(Vec3(p.x(), 0, 1 + p.y()).normalized());
  const auto H = homography_to_rays(a, rays);
  ASSERT_FALSE(H);
  EXPECT_EQ(H.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(H.error().message, HasSubstr("edge-on"));
  EXPECT_THROW((void)homography_to_rays(std::span(a).first(3), std::span(rays).first(3)),
               std::invalid_argument);
}

}  // namespace
}  // namespace plumbline::test
