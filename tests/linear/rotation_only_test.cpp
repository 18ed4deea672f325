// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/rotation_only.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "linear/scenes.hpp"
#include "plumbline/lens/lens.hpp"
#include "plumbline/linear/homography.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

TEST(RotationHomography, MovesPixelsOfPointsAtAnyDistance) {
  Rng rng(1);
  for (int i = 0; i < 200; ++i) {
    const Mat3 K1 = random_k(rng, {640, 480}), K2 = random_k(rng, {1280, 960}),
               R = so3_exp(rng.uniform(0, 0.5) * random_direction(rng));
    const Mat3 H = rotation_homography(K1, K2, R);
    const Vec3 p_1 = rng.uniform(0.1, 100) * Vec3(rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), 1);
    EXPECT_LT(((H * pinhole(K1, p_1).homogeneous()).hnormalized() - pinhole(K2, R * p_1)).norm(), 1e-9);
  }
}

TEST(RotationHomography, TwiceTheAngleIsTheSquare) {
  Rng rng(2);
  for (int i = 0; i < 200; ++i) {
    const Mat3 K = random_k(rng, {640, 480});
    const Vec3 half = rng.uniform(0, 1.5) * random_direction(rng);
    const Mat3 once = rotation_homography(K, K, so3_exp(half)),
               twice = rotation_homography(K, K, so3_exp(2 * half));
    EXPECT_LT(projective_distance(twice, once * once), 1e-12);
    EXPECT_LT((twice - once * once).norm() / twice.norm(),
              1e-12);  // the same scale even: det H = 1 for one K
  }
}

TEST(RotationFromHomography, TenThousandProblemsOfAnyScaleAndSign) {
  Rng rng(3);
  int good = 0;
  for (int i = 0; i < 10000; ++i) {
    const Mat3 K1 = random_k(rng, {640, 480}), K2 = random_k(rng, {640, 480}), R = random_rotation(rng);
    const double scale = std::pow(10, rng.uniform(-6, 6)) * (i % 2 ? -1 : 1);
    const auto back = rotation_from_homography(scale * rotation_homography(K1, K2, R), K1, K2);
    ASSERT_TRUE(back) << back.error().text();
    good += (back->R_2_1 - R).norm() < 1e-9;
    EXPECT_LT(back->residual, 1e-10);
    EXPECT_LT((back->R_2_1.transpose() * back->R_2_1 - Mat3::Identity()).norm(), 1e-14);
    EXPECT_GT(back->R_2_1.determinant(), 0);
  }
  EXPECT_EQ(good, 10000);
}

TEST(RotationFromHomography, ATranslationIsDetected) {
  Rng rng(4);
  const Mat3 K = random_k(rng, {640, 480}), R = so3_exp(Vec3(0.1, -0.2, 0.05));
  for (const double t : {0.03, 0.1, 0.5}) {
    for (int i = 0; i < 100; ++i) {
      // Singular values of R + t n' differ by t at most: by t/3 at least from 1 after the scale is out, when
      // t is across n or along it.
      const Vec3 n = so3_exp(rng.uniform(0, 0.8) * random_direction(rng)) * Vec3::UnitZ();
      const Mat3 H = -2.5 * K * (R + t * random_direction(rng) * n.transpose()) * K.inverse();
      const auto rotation = rotation_from_homography(H, K, K, 0.009);
      ASSERT_FALSE(rotation) << t;
      EXPECT_EQ(rotation.error().code, ErrorCode::kInvalidData);
      EXPECT_THAT(rotation.error().message, HasSubstr("translation"));
      EXPECT_THAT(rotation.error().message, HasSubstr("plane_motions"));
    }
  }
  EXPECT_EQ(rotation_from_homography(Mat3::Zero(), K, K).error().code, ErrorCode::kDegenerate);
  EXPECT_EQ(rotation_from_homography(Mat3::Constant(std::nan("")), K, K).error().code,
            ErrorCode::kInvalidData);
  EXPECT_THROW((void)rotation_from_homography(K, K, K, 0), std::invalid_argument);
}

TEST(RotationFromHomography, NoiseIsNotTakenForATranslation) {
  Rng rng(5);
  for (int i = 0; i < 200; ++i) {
    const Mat3 K = random_k(rng, {640, 480}), R = so3_exp(rng.uniform(0, 0.3) * random_direction(rng));
    const Mat3 H = rotation_homography(K, K, R);
    std::vector<Vec2> a, b;
    for (int k = 0; k < 100; ++k) {
      const double x = rng.uniform(0, 639);
      a.emplace_back(x, rng.uniform(0, 479));
      const double dx = rng.normal(0.3);
      b.push_back((H * a.back().homogeneous()).hnormalized() + Vec2(dx, rng.normal(0.3)));
    }
    const auto back = rotation_from_homography(homography(a, b).value(), K, K, 0.01);
    ASSERT_TRUE(back) << back.error().text();
    EXPECT_LT(rotation_angle(back->R_2_1.transpose() * R), 0.005);
  }
}

TEST(RotationFromRays, TenThousandProblems) {
  Rng rng(6);
  int good = 0;
  for (int i = 0; i < 10000; ++i) {
    const Mat3 R = random_rotation(rng);
    const Vec3 middle = random_direction(rng);
    std::vector<Vec3> rays_1, rays_2;
    for (int k = 0; k < 2 + i % 10; ++k) {
      rays_1.push_back((middle + 0.3 * random_direction(rng)).normalized());
      rays_2.push_back(R * rays_1.back());
    }
    const auto back = rotation_from_rays(rays_1, rays_2);
    ASSERT_TRUE(back) << back.error().text();
    good += (back->R_2_1 - R).norm() < 1e-9;
    EXPECT_LT(back->residual, 1e-7);
  }
  EXPECT_GE(good, 9900);
}

TEST(RotationFromRays, AnyLensAndTheErrorIsThatOfTheory) {
  Rng rng(7);
  const Lens lens = *make_lens("kb4", {1280, 960}, 300.0);
  const double sigma = 0.3 / 300;  // [rad]
  double squared = 0, residual = 0;
  for (int i = 0; i < 500; ++i) {
    const Mat3 R = random_rotation(rng);
    std::vector<Vec3> rays_1, rays_2;
    Mat3 information = Mat3::Zero();
    while (rays_1.size() < 50) {
      const double x = rng.uniform(0, 1279);
      const auto ray = unproject(lens, Vec2(x, rng.uniform(0, 959)));
      if (!ray) continue;
      const Vec3 seen = R * *ray;
      rays_1.push_back(*ray);
      rays_2.push_back(so3_exp(sigma * Vec3(rng.normal(), rng.normal(), rng.normal())) * seen);
      information += (Mat3::Identity() - seen * seen.transpose()) / (sigma * sigma);
    }
    const auto back = rotation_from_rays(rays_1, rays_2).value();
    const Vec3 error = so3_log(back.R_2_1 * R.transpose());
    squared += error.dot(information * error) / 500;
    residual += back.residual / sigma / 500;
  }
  EXPECT_NEAR(squared, 3, 0.3);  // three degrees of freedom; the mean of 500 has a sigma of 0.11
  EXPECT_NEAR(residual, std::sqrt(2 * (1 - 3.0 / 100)), 0.02);
}

TEST(RotationFromRays, RefusesParallelRaysAndSaysWhatToDo) {
  const std::vector<Vec3> same(4, Vec3(0.1, 0.2, 1).normalized());
  const auto rotation = rotation_from_rays(same, same);
  ASSERT_FALSE(rotation);
  EXPECT_EQ(rotation.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(rotation.error().message, HasSubstr("parallel"));
  EXPECT_THROW((void)rotation_from_rays(std::span(same).first(1), std::span(same).first(1)),
               std::invalid_argument);
  auto nan = same;
  nan[0].x() = std::nan("");
  EXPECT_EQ(rotation_from_rays(nan, same).error().code, ErrorCode::kInvalidData);
}

TEST(RotationFromRays, ATranslationShowsInTheResidual) {
  Rng rng(8);
  const Mat3 R = random_rotation(rng);
  std::vector<Vec3> rays_1, rays_2;
  for (int k = 0; k < 50; ++k) {
    const Vec3 p = Vec3(0, 0, 3) + random_vec3(rng, -1, 1);
    rays_1.push_back(p.normalized());
    rays_2.push_back((R * p + Vec3(0.3, 0, 0)).normalized());
  }
  EXPECT_GT(rotation_from_rays(rays_1, rays_2)->residual,
            0.01);  // 0.3 m at 2 to 4 m: the parallax differs by 0.04
}

}  // namespace
}  // namespace plumbline::test
