// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/homography.hpp"

#include <ceres/ceres.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <opencv2/calib3d.hpp>

#include "linear/scenes.hpp"
#include "plumbline/linear/homography.hpp"
#include "refine/projective.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;
using Vec9 = Eigen::Matrix<double, 9, 1>;
using Vec8 = Eigen::Matrix<double, 8, 1>;

// Two photographs of a plane: both in pixels.
Mat3 random_homography(Rng& rng) {
  const Mat3 K = random_k(rng, {640, 480});
  const SE3 T_1 = random_board_pose(rng, rng.uniform(0.8, 1.5), rng.uniform(0, 0.6)),
            T_2 = random_board_pose(rng, rng.uniform(0.8, 1.5), rng.uniform(0, 0.6));
  const Mat3 H_1 = K * T_1.matrix34()(Eigen::all, {0, 1, 3}), H_2 = K * T_2.matrix34()(Eigen::all, {0, 1, 3});
  const Mat3 H = H_2 * H_1.inverse();
  return H / H.norm();
}

Vec2 map(const Mat3& H, const Vec2& a) { return (H * a.homogeneous()).hnormalized(); }

struct Data {
  Mat3 truth;
  std::vector<Vec2> a, b;
};

Vec2 noise(Rng& rng, double sigma) {
  const double x = rng.normal(sigma);
  return {x, rng.normal(sigma)};
}

Data make_data(Rng& rng, int n, double sigma, HomographyNoise which) {
  Data d{random_homography(rng), {}, {}};
  while (static_cast<int>(d.a.size()) < n) {
    const double x = rng.uniform(100, 540);
    const Vec2 a(x, rng.uniform(80, 400));
    if (!(d.truth.row(2).dot(a.homogeneous()) > 0)) {
      d.truth = -d.truth;
      d.a.clear();
      d.b.clear();
      continue;
    }
    d.a.push_back(a);
    d.b.push_back(map(d.truth, a));
  }
  for (std::size_t i = 0; i < d.a.size(); ++i) {
    d.b[i] += noise(rng, sigma);
    if (which == HomographyNoise::kBoth) d.a[i] += noise(rng, sigma);
  }
  return d;
}

// Residuals of one correspondence for Ceres: H row by row, and the corrected point with kBoth.
struct SecondOnly {
  Vec2 a, b;
  template <class T>
  bool operator()(const T* h, T* r) const {
    const T w = h[6] * a.x() + h[7] * a.y() + h[8];
    r[0] = (h[0] * a.x() + h[1] * a.y() + h[2]) / w - b.x();
    r[1] = (h[3] * a.x() + h[4] * a.y() + h[5]) / w - b.y();
    return true;
  }
};
struct Both {
  Vec2 a, b;
  template <class T>
  bool operator()(const T* h, const T* p, T* r) const {
    const T w = h[6] * p[0] + h[7] * p[1] + h[8];
    r[0] = (h[0] * p[0] + h[1] * p[1] + h[2]) / w - b.x();
    r[1] = (h[3] * p[0] + h[4] * p[1] + h[5]) / w - b.y();
    r[2] = p[0] - a.x();
    r[3] = p[1] - a.y();
    return true;
  }
};

struct CeresResult {
  double cost;
  Mat3 H;
};

// H is fixed to H(2, 2) = 1, which no homography of these tests has near 0; coordinates in units of 500 px
// keep its columns alike.
CeresResult ceres_optimum(const Data& d, const Mat3& start, HomographyNoise which) {
  const Mat3 unit = Vec3(500, 500, 1).asDiagonal();
  const Mat3 scaled = unit.inverse() * start * unit / start(2, 2);
  std::array<double, 9> h;
  for (std::size_t i = 0; i < 9; ++i) h[i] = scaled(static_cast<int>(i / 3), static_cast<int>(i % 3));
  std::vector<Vec2> points = d.a;
  ceres::Problem problem;
  problem.AddParameterBlock(h.data(), 9, new ceres::SubsetManifold(9, {8}));
  for (std::size_t i = 0; i < d.a.size(); ++i) {
    points[i] /= 500;
    if (which == HomographyNoise::kSecond)
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<SecondOnly, 2, 9>(
                                   new SecondOnly{Vec2(d.a[i] / 500), Vec2(d.b[i] / 500)}),
                               nullptr, h.data());
    else
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<Both, 4, 9, 2>(new Both{Vec2(d.a[i] / 500), Vec2(d.b[i] / 500)}),
          nullptr, h.data(), points[i].data());
  }
  ceres::Solver::Options options;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-16;
  options.gradient_tolerance = 1e-18;
  options.parameter_tolerance = 1e-14;
  options.logging_type = ceres::SILENT;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  if (which == HomographyNoise::kSecond) options.linear_solver_type = ceres::DENSE_QR;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  Mat3 H = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(h.data());
  H = unit * H * unit.inverse();
  return {summary.final_cost * 500 * 500, H / H.norm()};
}

class RefineHomography : public ::testing::TestWithParam<HomographyNoise> {};
INSTANTIATE_TEST_SUITE_P(Noise, RefineHomography,
                         ::testing::Values(HomographyNoise::kSecond, HomographyNoise::kBoth),
                         [](const auto& param) {
                           return param.param == HomographyNoise::kSecond ? "InTheSecond" : "InBoth";
                         });

TEST_P(RefineHomography, ReachesCeresOptimum) {
  Rng rng(1);
  for (int i = 0; i < 30; ++i) {
    const Data d = make_data(rng, 8 + i, 1.0, GetParam());
    const Mat3 start = homography(d.a, d.b).value();
    const auto ours = refine_homography(start, d.a, d.b, 1.0, GetParam());
    ASSERT_TRUE(ours) << ours.error().text();
    const CeresResult ceres = ceres_optimum(d, start, GetParam());
    const double cost = 0.5 * ours->rms_px * ours->rms_px * static_cast<double>(d.a.size());
    EXPECT_NEAR(cost, ceres.cost, 1e-9 * ceres.cost);
    EXPECT_LT(projective_distance(ours->H, ceres.H), 1e-5);  // sqrt of the relative cost that doubles resolve
  }
}

TEST_P(RefineHomography, TenThousandProblemsWithoutNoise) {
  Rng rng(2);
  int good = 0, wrong = 0;
  for (int i = 0; i < 10000; ++i) {
    const Data d = make_data(rng, 10, 0, GetParam());
    // From a start that is off by a per cent, which the noise-free closed form is not.
    Mat3 start = d.truth;
    for (int r = 0; r < 3; ++r) start.row(r) *= 1 + rng.uniform(-0.01, 0.01);
    const auto H = refine_homography(start, d.a, d.b, 1.0, GetParam());
    if (!H) continue;
    const double error = (H->H - d.truth).norm();  // the sign too
    good += error < 1e-9;
    wrong += error > 1e-6;
  }
  EXPECT_GE(good, 9900);
  EXPECT_EQ(wrong, 0);
}

TEST_P(RefineHomography, OverAThousandTrialsTheCovarianceIsRight) {
  Rng rng(3);
  Data exact = make_data(rng, 40, 0, GetParam());
  const double sigma = 0.5;
  const Vec9 h = detail::row_major<3>(exact.truth);
  const Eigen::Matrix<double, 9, 8> B = detail::tangent_basis<9>(h);
  Vec8 mean = Vec8::Zero(), predicted = Vec8::Zero();
  double squared = 0, linear = 0, refined = 0, rms = 0;
  constexpr int kTrials = 1000;
  for (int i = 0; i < kTrials; ++i) {
    Data d = exact;
    for (std::size_t k = 0; k < d.a.size(); ++k) {
      d.b[k] += noise(rng, sigma);
      if (GetParam() == HomographyNoise::kBoth) d.a[k] += noise(rng, sigma);
    }
    const Mat3 start = homography(d.a, d.b).value();
    const auto found = refine_homography(start, d.a, d.b, sigma, GetParam());
    ASSERT_TRUE(found);
    const Vec8 error = B.transpose() * (detail::row_major<3>(found->H) - h);
    const Eigen::Matrix<double, 8, 8> C = B.transpose() * found->covariance * B;
    squared += error.dot(C.ldlt().solve(error)) / kTrials;
    mean += error / kTrials;
    predicted += C.diagonal().cwiseSqrt() / kTrials;
    refined += error.squaredNorm() / kTrials;
    linear += (B.transpose() * (detail::row_major<3>(start) - h)).squaredNorm() / kTrials;
    rms += found->rms_px * found->rms_px / kTrials;
  }
  EXPECT_LT(mean.cwiseQuotient(predicted).cwiseAbs().maxCoeff(), 0.2);
  EXPECT_NEAR(squared, 8, 0.8);  // of 1,000: standard deviation 0.13
  EXPECT_LT(std::sqrt(linear / refined), 2) << "the closed form is a good start";
  EXPECT_NEAR(rms, sigma * sigma * (2 * 40 - 8) / 40, 0.03 * sigma * sigma * 2);
}

TEST_P(RefineHomography, TheCovarianceHasRankEightAcrossH) {
  Rng rng(4);
  const Data d = make_data(rng, 30, 0.5, GetParam());
  const auto found = refine_homography(homography(d.a, d.b).value(), d.a, d.b, 0.5, GetParam()).value();
  EXPECT_NEAR(found.H.norm(), 1, 1e-14);
  const Vec9 h = detail::row_major<3>(found.H);
  EXPECT_LT((found.covariance * h).norm(), 1e-12 * found.covariance.norm());
  EXPECT_LT((found.covariance - found.covariance.transpose()).norm(), 1e-14 * found.covariance.norm());
  // Twice the sigma, four times the covariance, and the same H.
  const auto twice = refine_homography(homography(d.a, d.b).value(), d.a, d.b, 1.0, GetParam()).value();
  EXPECT_LT((twice.covariance - 4 * found.covariance).norm(), 1e-6 * twice.covariance.norm());
  EXPECT_LT((twice.H - found.H).norm(), 1e-6);
}

TEST(RefineHomography, OfTheSecondImageIsOpenCvs) {
  // findHomography(0) ends with Levenberg-Marquardt on the same cost.
  Rng rng(5);
  for (int i = 0; i < 50; ++i) {
    const Data d = make_data(rng, 30, 0.5, HomographyNoise::kSecond);
    std::vector<cv::Point2d> a, b;
    for (std::size_t k = 0; k < d.a.size(); ++k) {
      a.emplace_back(d.a[k].x(), d.a[k].y());
      b.emplace_back(d.b[k].x(), d.b[k].y());
    }
    const cv::Mat H = cv::findHomography(a, b, 0);
    const Mat3 H_cv = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(H.ptr<double>());
    const auto ours =
        refine_homography(homography(d.a, d.b).value(), d.a, d.b, 0.5, HomographyNoise::kSecond).value();
    double cost = 0;
    for (std::size_t k = 0; k < d.a.size(); ++k) cost += (map(H_cv, d.a[k]) - d.b[k]).squaredNorm() / 30;
    EXPECT_LE(ours.rms_px, std::sqrt(cost) * (1 + 1e-12));
    EXPECT_NEAR(ours.rms_px, std::sqrt(cost), 1e-5);
  }
}

TEST_P(RefineHomography, RefusesPointsThatDoNotDetermineIt) {
  Rng rng(6);
  Data d = make_data(rng, 12, 0, GetParam());
  for (std::size_t i = 1; i < d.a.size(); ++i) {  // all but one on a line, with noise across it in b only
    d.a[i].y() = 0.3 * d.a[i].x() + 50;
    d.b[i] = map(d.truth, d.a[i]);
  }
  if (GetParam() == HomographyNoise::kSecond) {
    for (Vec2& b : d.b) b += noise(rng, 0.5);
  }
  const auto line = refine_homography(d.truth, d.a, d.b, 1.0, GetParam());
  ASSERT_FALSE(line);
  EXPECT_EQ(line.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(line.error().message, HasSubstr("do not determine the homography"));
  EXPECT_THROW(
      (void)refine_homography(d.truth, std::span(d.a).first(3), std::span(d.b).first(3), 1.0, GetParam()),
      std::invalid_argument);
  EXPECT_THROW((void)refine_homography(d.truth, d.a, d.b, 0.0, GetParam()), std::invalid_argument);
  d.b[0].x() = std::nan("");
  EXPECT_EQ(refine_homography(d.truth, d.a, d.b, 1.0, GetParam()).error().code, ErrorCode::kInvalidData);
}

}  // namespace
}  // namespace plumbline::test
