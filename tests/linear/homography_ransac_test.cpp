// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

#include "linear/scenes.hpp"
#include "plumbline/linear/homography.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

Mat3 random_homography(Rng& rng) {
  const Mat3 K = random_k(rng, {640, 480});
  const SE3 T = random_board_pose(rng, rng.uniform(0.4, 1.5), rng.uniform(0, 0.9));
  const Mat3 H = K * T.matrix34()(Eigen::all, {0, 1, 3});
  return H / H.norm();
}

Vec2 map(const Mat3& H, const Vec2& a) { return (H * a.homogeneous()).hnormalized(); }

TEST(HomographyFromFour, TenThousandProblems) {
  Rng rng(1);
  int good = 0, wrong = 0;
  for (int i = 0; i < 10000; ++i) {
    const Mat3 truth = random_homography(rng);
    std::array<Vec2, 4> a, b;
    const double turn = rng.uniform(0, 6.28);
    for (std::size_t k = 0; k < 4; ++k) {
      const double angle = turn + 1.57 * static_cast<double>(i % 2 ? k : 3 - k) + rng.uniform(-0.5, 0.5);
      a[k] = rng.uniform(0.08, 0.2) * Vec2(std::cos(angle), std::sin(angle));
      b[k] = map(truth, a[k]);
    }
    const auto H = homography_from_four(a, b);
    ASSERT_TRUE(H);
    const double error = (*H - truth).norm();  // the sign too
    good += error < 1e-9;
    wrong += error > 1e-6;
    EXPECT_NEAR(H->norm(), 1, 1e-14);
  }
  EXPECT_GE(good, 9900);
  EXPECT_EQ(wrong, 0);
}

TEST(HomographyFromFour, AgreesWithTheDltWhereverItAnswers) {
  Rng rng(2);
  int both = 0, one_side = 0;
  for (int i = 0; i < 2000; ++i) {
    std::array<Vec2, 4> a, b;
    for (std::size_t k = 0; k < 4; ++k) {
      a[k] = {rng.uniform(0, 640), rng.uniform(0, 480)};
      b[k] = {rng.uniform(0, 640), rng.uniform(0, 480)};
    }
    const auto dlt = homography(a, b);
    const auto H = homography_from_four(a, b);
    if (!dlt) continue;
    bool positive = true;
    for (const Vec2& p : a) positive = positive && dlt->row(2).dot(p.homogeneous()) > 0;
    EXPECT_EQ(H.has_value(), positive);
    one_side += positive;
    if (!H) continue;
    for (std::size_t k = 0; k < 4; ++k) EXPECT_LT((map(*H, a[k]) - b[k]).norm(), 1e-6);
    both += projective_distance(*H, *dlt) < 1e-9;
  }
  EXPECT_GT(one_side, 100);
  EXPECT_GT(both, 0.98 * one_side);  // random quadrangles may be thin
}

TEST(HomographyFromFour, ThreeOnALineGiveNone) {
  const std::array<Vec2, 4> square{Vec2(0, 0), Vec2(1, 0), Vec2(1, 1), Vec2(0, 1)},
      line{Vec2(0, 0), Vec2(0.5, 0.25), Vec2(1, 0.5), Vec2(0, 1)},
      twin{Vec2(0, 0), Vec2(0, 0), Vec2(1, 1), Vec2(0, 1)};
  EXPECT_FALSE(homography_from_four(square, line));
  EXPECT_FALSE(homography_from_four(line, square));
  EXPECT_FALSE(homography_from_four(twin, square));
  EXPECT_TRUE(homography_from_four(square, square));
}

struct Data {
  Mat3 truth;
  std::vector<Vec2> a, b;
  std::vector<bool> inlier;
  std::vector<cv::Point2d> cv_a, cv_b;
};

Data make_data(Rng& rng, int n, double outliers, double sigma) {
  Data d;
  d.truth = random_homography(rng);
  for (int i = 0; i < n; ++i) {
    const double x = rng.uniform(-0.2, 0.2);
    d.a.emplace_back(x, rng.uniform(-0.2, 0.2));
    const bool out = rng.uniform() < outliers;
    const double dx = rng.normal(sigma), dy = rng.normal(sigma), u = rng.uniform(0, 640);
    d.b.push_back(out ? Vec2(u, rng.uniform(0, 480)) : Vec2(map(d.truth, d.a.back()) + Vec2(dx, dy)));
    d.inlier.push_back(!out);
    d.cv_a.emplace_back(d.a.back().x(), d.a.back().y());
    d.cv_b.emplace_back(d.b.back().x(), d.b.back().y());
  }
  return d;
}

double transfer_error(const Mat3& H, const Data& d) {  // against the truth, over all points
  double sum = 0;
  for (const Vec2& a : d.a) sum += (map(H, a) - map(d.truth, a)).squaredNorm();
  return std::sqrt(sum / static_cast<double>(d.a.size()));
}

TEST(HomographyRansac, FindsThePlaneAmongOutliersAsWellAsOpenCv) {
  Rng rng(3);
  double ours = 0, opencv = 0;
  for (int i = 0; i < 200; ++i) {
    const Data d = make_data(rng, 150, i % 2 ? 0.3 : 0.6, 0.5);
    RansacOptions options;
    options.seed = static_cast<std::uint64_t>(i);
    const auto found = homography_ransac(d.a, d.b, options);
    ASSERT_TRUE(found) << found.error().text();
    int missed = 0, taken = 0;
    for (std::size_t k = 0; k < d.a.size(); ++k) {
      missed += d.inlier[k] && !found->consensus.inlier[k];
      taken += !d.inlier[k] && found->consensus.inlier[k];
    }
    EXPECT_LE(missed, 4);  // 2 px are 4 sigma: 3 in 10,000
    EXPECT_LE(taken, 3);   // 4 pi of 307,200 px
    // 60 inliers, 8 degrees of freedom less: 0.68, standard deviation 0.045.
    EXPECT_NEAR(found->consensus.rms_px, 0.68, 0.2);
    EXPECT_NEAR(found->model.norm(), 1, 1e-14);
    const cv::Mat H = cv::findHomography(d.cv_a, d.cv_b, cv::RANSAC, 2.0, cv::noArray(), 10000, 0.9999);
    ours += transfer_error(found->model, d) / 200;
    opencv += transfer_error(Eigen::Matrix<double, 3, 3, Eigen::RowMajor>(H.ptr<double>()), d) / 200;
  }
  EXPECT_LT(ours, 1.05 * opencv);  // OpenCV ends with Levenberg-Marquardt
  EXPECT_LT(ours, 0.25);           // 0.5 px sqrt(8 / 60..105) on points, some of them beyond the inliers
}

TEST(HomographyRansac, TheThreadsDoNotMatterAndTheSeedIsTheAnswer) {
  Rng rng(4);
  const Data d = make_data(rng, 300, 0.75, 0.5);
  RansacOptions options;
  options.seed = 7;
  const auto one = homography_ransac(d.a, d.b, options).value();
  for (int n_threads : {2, 8}) {
    options.n_threads = n_threads;
    const auto other = homography_ransac(d.a, d.b, options).value();
    EXPECT_EQ(one.model, other.model);
    EXPECT_EQ(one.consensus.inlier, other.consensus.inlier);
    EXPECT_EQ(one.consensus.n_hypotheses, other.consensus.n_hypotheses);
  }
}

TEST(HomographyRansac, InliersAreThoseOfTheStatedRule) {
  Rng rng(5);
  const Data d = make_data(rng, 100, 0.4, 1);
  const auto found = homography_ransac(d.a, d.b, {.inlier_px = 1.5}).value();
  double sum = 0;
  for (std::size_t k = 0; k < d.a.size(); ++k) {
    const double e = (map(found.model, d.a[k]) - d.b[k]).norm();
    EXPECT_EQ(found.consensus.inlier[k], e <= 1.5);
    if (e <= 1.5) sum += e * e;
  }
  EXPECT_NEAR(found.consensus.rms_px, std::sqrt(sum / found.consensus.n_inliers), 1e-9);
}

TEST(HomographyRansac, WithoutNoiseAndOutliersItIsExact) {
  Rng rng(6);
  for (int i = 0; i < 500; ++i) {
    const Data d = make_data(rng, 4 + i % 30, 0, 0);
    const auto found = homography_ransac(d.a, d.b, {});
    if (!found) {
      EXPECT_EQ(found.error().code, ErrorCode::kDegenerate);  // four random points may be thin
      continue;
    }
    EXPECT_LT(transfer_error(found->model, d), 1e-6);
    EXPECT_EQ(found->consensus.n_inliers, static_cast<int>(d.a.size()));
  }
}

TEST(HomographyRansac, RefusesChance) {
  // Of 100 unrelated pairs five or six agree within 2 px with the best of thousands of samples.
  Rng rng(8);
  for (int i = 0; i < 20; ++i) {
    const Data d = make_data(rng, 100, 1, 0);
    const auto found = homography_ransac(d.a, d.b, {.max_hypotheses = 5000});
    ASSERT_FALSE(found);
    EXPECT_EQ(found.error().code, ErrorCode::kDegenerate);
    EXPECT_THAT(found.error().message, HasSubstr("more inliers than chance gives"));
  }
}

TEST(HomographyRansac, RefusesWhatDoesNotAgree) {
  Rng rng(7);
  Data d = make_data(rng, 12, 1, 0);
  const auto nothing = homography_ransac(d.a, d.b, {.inlier_px = 0.01});
  ASSERT_FALSE(nothing);
  EXPECT_EQ(nothing.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(nothing.error().message, HasSubstr("more inliers than chance gives"));
  std::vector<Vec2> line;
  for (int i = 0; i < 12; ++i) line.emplace_back(10.0 * i, 20.0 * i);
  const auto flat = homography_ransac(line, d.b, {});
  ASSERT_FALSE(flat);
  EXPECT_EQ(flat.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(flat.error().message, HasSubstr("lie on a line"));
  EXPECT_THROW((void)homography_ransac(std::span(line).first(3), std::span(d.b).first(3), {}),
               std::invalid_argument);
  EXPECT_THROW((void)homography_ransac(d.a, d.b, {.inlier_px = -1}), std::invalid_argument);
  d.b[2].y() = std::nan("");
  EXPECT_EQ(homography_ransac(d.a, d.b, {}).error().code, ErrorCode::kInvalidData);
}

}  // namespace
}  // namespace plumbline::test
