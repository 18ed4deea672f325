// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rectify/uncalibrated.hpp"

#include <gmock/gmock.h>

#include <opencv2/calib3d.hpp>

#include "plumbline/core/random.hpp"
#include "plumbline/geometry/so3.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
using ::testing::HasSubstr;

constexpr ImageSize kSize{640, 480};

// Two pinhole cameras, x2 = R x1 + t, and what they see.
struct Pair {
  Mat3 K1, K2, R, F;
  Vec3 t;
  std::vector<Vec2> px1, px2;
};

Mat3 intrinsics(double f, double cx, double cy) {
  return (Mat3() << f, 0, cx, 0, 1.01 * f, cy, 0, 0, 1).finished();
}

Pair pair_of(const Mat3& K1, const Mat3& K2, const Mat3& R, const Vec3& t, int n = 60, unsigned seed = 1,
             double noise_px = 0) {
  Pair pair{K1, K2, R, K2.inverse().transpose() * skew(t) * R * K1.inverse(), t, {}, {}};
  Rng random(seed);
  for (int tries = 0; static_cast<int>(pair.px1.size()) < n && tries < 100 * n; ++tries) {
    const Vec2 a(random.uniform(0, kSize.width - 1), random.uniform(0, kSize.height - 1));
    const Vec3 p = random.uniform(2, 6) * K1.inverse() * a.homogeneous(), q = R * p + t;
    const Vec2 b = (K2 * q).hnormalized();
    if (q.z() < 0 || b.minCoeff() < 0 || b.x() > kSize.width - 1 || b.y() > kSize.height - 1) continue;
    pair.px1.push_back(a + noise_px * Vec2(random.normal(), random.normal()));
    pair.px2.push_back(b + noise_px * Vec2(random.normal(), random.normal()));
  }
  return pair;
}

Pair ordinary(unsigned seed, double noise_px = 0) {
  Rng random(seed);
  const Vec3 w(random.uniform(-0.15, 0.15), random.uniform(-0.15, 0.15), random.uniform(-0.15, 0.15));
  const Vec3 centre(random.uniform(0.3, 0.6) * (seed % 2 ? 1 : -1), random.uniform(-0.1, 0.1),
                    random.uniform(-0.05, 0.05));
  const Mat3 R = so3_exp(w);
  return pair_of(intrinsics(random.uniform(450, 650), 330, 228),
                 intrinsics(random.uniform(450, 650), 310, 250), R, -R * centre, 60, seed, noise_px);
}

Vec2 apply(const Mat3& H, const Vec2& p) { return (H * p.homogeneous()).hnormalized(); }

// Rows after H, over the points; and both signs that nothing was mirrored or torn.
double worst_row(const UncalibratedRectification& r, const Pair& pair) {
  double worst = 0;
  const int across = r.vertical ? 0 : 1;
  for (std::size_t i = 0; i < pair.px1.size(); ++i)
    worst = std::max(worst, std::abs((apply(r.H[0], pair.px1[i]) - apply(r.H[1], pair.px2[i]))[across]));
  return worst;
}

void expect_upright(const UncalibratedRectification& r) {
  for (const Mat3& H : r.H) {
    EXPECT_GT(H.determinant(), 0);
    EXPECT_NEAR((H * Vec3(319.5, 239.5, 1)).z(), 1, 1e-12);
    for (const Vec2& corner : {Vec2(-0.5, -0.5), Vec2(639.5, -0.5), Vec2(-0.5, 479.5), Vec2(639.5, 479.5)})
      EXPECT_GT((H * corner.homogeneous()).z(), 0);
  }
  const Vec2 up = apply(r.H[0], {319.5, 229.5}) - apply(r.H[0], {319.5, 239.5});
  EXPECT_LT(up.y(), 0);
  EXPECT_LT(std::abs(up.x()), std::abs(up.y()));
}

TEST(RectifyUncalibrated, RowsMatchWithoutNoise) {
  for (unsigned seed = 1; seed <= 100; ++seed) {
    const Pair pair = ordinary(seed);
    const auto r = rectify_uncalibrated((seed % 3 ? -7.0 : 1e-5) * pair.F, pair.px1, pair.px2, kSize);
    ASSERT_TRUE(r) << seed << r.error().text();
    // Coordinates of some 500 px with 1e-16 relative, through a dozen operations and F's condition of ~1e3.
    EXPECT_LT(worst_row(*r, pair), 1e-9) << seed;
    EXPECT_LT(r->row_rms_px, 1e-9);
    EXPECT_FALSE(r->vertical);
    expect_upright(*r);
    // What Hartley demands of the pair: F ~ H2' [i]_x H1.
    const Mat3 F = r->H[1].transpose() * skew(Vec3::UnitX()) * r->H[0];
    EXPECT_NEAR(std::abs((F / F.norm()).cwiseProduct(pair.F / pair.F.norm()).sum()), 1, 1e-9) << seed;
  }
}

TEST(RectifyUncalibrated, NoNeighbourInTheFamilyIsLessDistorted) {
  // Everything that may be done to both images and leaves the rows matched: a common perspective along y, a
  // common stretch of y, and shear and stretch of x for each.
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Pair pair = ordinary(seed);
    const auto r = rectify_uncalibrated(pair.F, pair.px1, pair.px2, kSize).value();
    const auto cost = [](const std::array<Mat3, 2>& H) {
      return std::pow(homography_distortion(H[0], kSize), 2) +
             std::pow(homography_distortion(H[1], kSize), 2);
    };
    const double best = cost(r.H);
    const Mat3 centred = (Mat3() << 1, 0, -319.5, 0, 1, -239.5, 0, 0, 1).finished();
    for (int parameter = 0; parameter < 6; ++parameter) {
      for (const double step : {-1e-3, 1e-3}) {
        std::array<Mat3, 2> A{Mat3::Identity(), Mat3::Identity()};
        if (parameter == 0) A[0](2, 1) = A[1](2, 1) = step / 400;
        if (parameter == 1) A[0](1, 1) = A[1](1, 1) = 1 + step;
        if (parameter >= 2) A[parameter / 2 - 1](0, parameter % 2) += step;
        std::array<Mat3, 2> H;
        for (int i = 0; i < 2; ++i) H[i] = centred.inverse() * A[i] * centred * r.H[i];
        EXPECT_GT(cost(H), best) << seed << " parameter " << parameter << " step " << step;
      }
    }
  }
}

TEST(RectifyUncalibrated, DistortsLessThanOpenCVAtTheSameRows) {
  int n = 0, n_calmer = 0;
  for (unsigned seed = 1; seed <= 50; ++seed) {
    const Pair pair = ordinary(seed, 0.3);
    std::vector<cv::Point2d> a, b;
    for (std::size_t i = 0; i < pair.px1.size(); ++i) {
      a.emplace_back(pair.px1[i].x(), pair.px1[i].y());
      b.emplace_back(pair.px2[i].x(), pair.px2[i].y());
    }
    cv::Matx33d F_cv, H1, H2;
    for (int i = 0; i < 9; ++i) F_cv(i / 3, i % 3) = pair.F(i / 3, i % 3);
    if (!cv::stereoRectifyUncalibrated(a, b, F_cv, {kSize.width, kSize.height}, H1, H2)) continue;
    const auto r = rectify_uncalibrated(pair.F, pair.px1, pair.px2, kSize).value();
    Mat3 theirs[2];
    for (int i = 0; i < 9; ++i) {
      theirs[0](i / 3, i % 3) = H1(i / 3, i % 3);
      theirs[1](i / 3, i % 3) = H2(i / 3, i % 3);
    }
    double their_rows = 0;
    for (std::size_t i = 0; i < pair.px1.size(); ++i)
      their_rows += std::pow((apply(theirs[0], pair.px1[i]) - apply(theirs[1], pair.px2[i])).y(), 2);
    their_rows = std::sqrt(their_rows / static_cast<double>(pair.px1.size()));
    const double ours = std::hypot(r.distortion[0], r.distortion[1]);
    const double their =
        std::hypot(homography_distortion(theirs[0], kSize), homography_distortion(theirs[1], kSize));
    // A map that shrinks also shrinks the error: compared relative to the stretch, of which neither is far
    // off.
    EXPECT_LT(r.row_rms_px, 1.25 * their_rows) << seed;
    n_calmer += ours <= their;
    ++n;
  }
  EXPECT_GT(n, 45);
  EXPECT_EQ(n_calmer, n);
}

TEST(RectifyUncalibrated, ARectifiedPairStaysAsItIs) {
  // Both epipoles at infinity along the rows: nothing is left to do.
  const Mat3 K = intrinsics(500, 320, 240);
  const Pair pair = pair_of(K, K, Mat3::Identity(), {-0.2, 0, 0});
  const auto r = rectify_uncalibrated(pair.F, pair.px1, pair.px2, kSize).value();
  for (int i = 0; i < 2; ++i) {
    EXPECT_LT(r.distortion[i], 1e-7);  // the root of the measure's rounding
    EXPECT_LT((r.H[i].leftCols<2>() - Mat3::Identity().leftCols<2>()).norm(), 1e-7);
    EXPECT_LT((r.H[i].col(2) - Vec3::UnitZ()).norm(), 1e-4);  // 1e-7 times 320 px
  }
  // f b / Z for Z from 2 to 6.
  EXPECT_GT(r.min_disparity_px, 500 * 0.2 / 6 - 1e-3);
  EXPECT_LT(r.max_disparity_px, 500 * 0.2 / 2 + 1e-3);
}

TEST(RectifyUncalibrated, OneEpipoleAtInfinity) {
  // The second camera is turned about its axis and y; the first one's baseline is along its rows.
  const Mat3 K = intrinsics(500, 320, 240), R = so3_exp({0, 0.2, 0.1});
  const Pair pair = pair_of(K, K, R, R * Vec3(-0.3, 0, 0));
  const auto r = rectify_uncalibrated(pair.F, pair.px1, pair.px2, kSize).value();
  EXPECT_LT(worst_row(r, pair), 1e-9);
  expect_upright(r);
}

TEST(RectifyUncalibrated, OneCameraAboveTheOther) {
  const Mat3 R = so3_exp({0.1, 0.05, -0.08});
  const Pair pair =
      pair_of(intrinsics(500, 320, 240), intrinsics(520, 320, 240), R, R * Vec3(0.03, -0.4, 0.02));
  const auto r = rectify_uncalibrated(pair.F, pair.px1, pair.px2, kSize).value();
  EXPECT_TRUE(r.vertical);
  EXPECT_LT(worst_row(r, pair), 1e-9);
  expect_upright(r);
}

TEST(RectifyUncalibrated, ASecondCameraUpsideDownIsTurnedNotMirrored) {
  const Mat3 R = so3_exp({0, 0, 3.0}) * so3_exp({0.05, 0.1, 0});
  const Pair pair =
      pair_of(intrinsics(500, 320, 240), intrinsics(500, 320, 240), R, R * Vec3(-0.4, 0.02, 0.03));
  ASSERT_GT(pair.px1.size(), 30u);
  const auto r = rectify_uncalibrated(pair.F, pair.px1, pair.px2, kSize).value();
  EXPECT_LT(worst_row(r, pair), 1e-9);
  expect_upright(r);
  const Vec2 along = apply(r.H[1], {329.5, 239.5}) - apply(r.H[1], {319.5, 239.5});
  EXPECT_LT(along.x(), -5);
}

TEST(RectifyUncalibrated, LeastDisparityFlattensAPlane) {
  const Mat3 K = intrinsics(500, 320, 240), R = so3_exp({0.02, 0.1, -0.03});
  const Vec3 t = R * Vec3(-0.4, 0.02, 0.03), normal(0.2, 0.1, 0.3);
  Pair plane{K, K, R, K.inverse().transpose() * skew(t) * R * K.inverse(), t, {}, {}};
  for (int i = 0; i < 30; ++i) {
    const Vec2 a(50 + 100 * (i % 6), 50 + 80 * (i / 6));
    const Vec3 ray = K.inverse() * a.homogeneous();
    plane.px1.push_back(a);
    plane.px2.push_back((K * (R * ray / normal.dot(ray) + t)).hnormalized());
  }
  const auto r =
      rectify_uncalibrated(plane.F, plane.px1, plane.px2, kSize, {RowFreedom::kLeastDisparity}).value();
  EXPECT_LT(worst_row(r, plane), 1e-9);
  EXPECT_LT(std::max(r.max_disparity_px, -r.min_disparity_px), 1e-7);
  const auto calm = rectify_uncalibrated(plane.F, plane.px1, plane.px2, kSize).value();
  EXPECT_GT(calm.max_disparity_px - calm.min_disparity_px, 1);
  EXPECT_LT(calm.distortion[0] + calm.distortion[1], r.distortion[0] + r.distortion[1]);
}

TEST(RectifyUncalibrated, EpipolesInsideAreRefusedByName) {
  const Mat3 K = intrinsics(500, 320, 240);
  const Pair forward = pair_of(K, K, Mat3::Identity(), {0.02, 0.01, -0.4});
  const auto r = rectify_uncalibrated(forward.F, forward.px1, forward.px2, kSize);
  ASSERT_FALSE(r);
  EXPECT_EQ(r.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(r.error().text(), HasSubstr("the epipole of image 1 lies inside it, at (295.0, 227.4)"));
  // Inside the second image only.
  const Pair turned = pair_of(K, K, so3_exp({0, 0.9, 0}), {0.05, 0, 0.5}, 0);
  EXPECT_THAT(rectify_uncalibrated(turned.F, {}, {}, kSize).error().text(), HasSubstr("epipole of image 2"));
}

TEST(RectifyUncalibrated, BadInput) {
  const Pair pair = ordinary(1);
  const Mat3 rank1 = Vec3(1, 2, 3) * Vec3(4, 5, 6).transpose();
  EXPECT_EQ(rectify_uncalibrated(rank1, {}, {}, kSize).error().code, ErrorCode::kDegenerate);
  EXPECT_EQ(rectify_uncalibrated(Mat3::Zero(), {}, {}, kSize).error().code, ErrorCode::kDegenerate);
  EXPECT_EQ(rectify_uncalibrated(pair.F * std::nan(""), {}, {}, kSize).error().code, ErrorCode::kInvalidData);
  EXPECT_EQ(rectify_uncalibrated(pair.F, {}, {}, {0, 480}).error().code, ErrorCode::kInvalidData);
  EXPECT_THROW((void)rectify_uncalibrated(pair.F, pair.px1, {}, kSize), std::invalid_argument);
  EXPECT_EQ(rectify_uncalibrated(pair.F, std::vector<Vec2>(2, Vec2(1, 2)), std::vector<Vec2>(2, Vec2(1, 2)),
                                 kSize, {RowFreedom::kLeastDisparity})
                .error()
                .code,
            ErrorCode::kDegenerate);
  // No points are needed, and the centres stay in the middle.
  const auto r = rectify_uncalibrated(pair.F, {}, {}, kSize).value();
  for (const Mat3& H : r.H) EXPECT_NEAR(apply(H, {319.5, 239.5}).x(), 319.5, 1e-9);
}

TEST(HomographyDistortion, OfKnownMaps) {
  const Mat3 turn = (Mat3() << 0, -1, 700, 1, 0, 3, 0, 0, 1).finished();
  EXPECT_NEAR(homography_distortion(turn, kSize), 0, 1e-12);
  // Stretched by 1.3 along x: one of two stretches is 0.3 off.
  EXPECT_NEAR(homography_distortion(Vec3(1.3, 1, 1).asDiagonal(), kSize), 0.3 / std::sqrt(2.0), 1e-12);
  EXPECT_NEAR(homography_distortion(Vec3(2, 2, 1).asDiagonal(), kSize), 1, 1e-12);
}

}  // namespace
}  // namespace plumbline
