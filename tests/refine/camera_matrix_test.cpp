// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/camera_matrix.hpp"

#include <ceres/ceres.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>

#include "linear/scenes.hpp"
#include "plumbline/geometry/image_formation.hpp"
#include "plumbline/linear/camera_matrix.hpp"
#include "refine/projective.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;
using Vec12 = Eigen::Matrix<double, 12, 1>;
using Vec11 = Eigen::Matrix<double, 11, 1>;

struct Scene {
  Mat34 P;  // |P| = 1
  std::vector<Vec3> p_world;
  std::vector<Vec2> px;
};

Scene random_scene(Rng& rng, int n, double sigma) {
  const Mat3 K = random_k(rng, {640, 480});
  const SE3 T(random_rotation(rng),
              rng.uniform(1, 2) * Vec3(rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 1));
  Scene s{compose_camera_matrix(K, T), {}, {}};
  s.P /= s.P.norm();
  for (int i = 0; i < n; ++i) {
    s.p_world.push_back(random_vec3(rng, -0.4, 0.4));
    const double dx = rng.normal(sigma);
    s.px.push_back(pinhole(K, T * s.p_world.back()) + Vec2(dx, rng.normal(sigma)));
  }
  return s;
}

struct Reprojection {
  Vec3 X;
  Vec2 px;
  template <class T>
  bool operator()(const T* p, T* r) const {
    T x[3];
    for (int i = 0; i < 3; ++i)
      x[i] = p[4 * i] * X.x() + p[4 * i + 1] * X.y() + p[4 * i + 2] * X.z() + p[4 * i + 3];
    r[0] = x[0] / x[2] - px.x();
    r[1] = x[1] / x[2] - px.y();
    return true;
  }
};

TEST(RefineCameraMatrix, ReachesCeresOptimum) {
  Rng rng(1);
  for (int i = 0; i < 30; ++i) {
    const Scene s = random_scene(rng, 10 + i, 1.0);
    const Mat34 start = camera_matrix(s.p_world, s.px).value();
    const auto ours = refine_camera_matrix(start, s.p_world, s.px, 1.0);
    ASSERT_TRUE(ours) << ours.error().text();
    // P(2, 3), the depth of the world's origin, is fixed to 1; pixels in units of 500.
    Mat34 scaled = Vec3(1.0 / 500, 1.0 / 500, 1).asDiagonal() * start / start(2, 3);
    std::array<double, 12> p;
    for (std::size_t k = 0; k < 12; ++k) p[k] = scaled(static_cast<int>(k / 4), static_cast<int>(k % 4));
    ceres::Problem problem;
    problem.AddParameterBlock(p.data(), 12, new ceres::SubsetManifold(12, {11}));
    for (std::size_t k = 0; k < s.px.size(); ++k)
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Reprojection, 2, 12>(
                                   new Reprojection{s.p_world[k], Vec2(s.px[k] / 500)}),
                               nullptr, p.data());
    ceres::Solver::Options options;
    options.max_num_iterations = 200;
    options.function_tolerance = 1e-16;
    options.gradient_tolerance = 1e-18;
    options.parameter_tolerance = 1e-14;
    options.logging_type = ceres::SILENT;
    options.linear_solver_type = ceres::DENSE_QR;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    const double cost = 0.5 * ours->rms_px * ours->rms_px * static_cast<double>(s.px.size());
    EXPECT_NEAR(cost, summary.final_cost * 500 * 500, 1e-9 * cost);
    const Mat34 P_ceres = Vec3(500, 500, 1).asDiagonal() *
                          Mat34(Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(p.data()));
    EXPECT_LT(projective_distance(ours->P, P_ceres), 1e-5);  // sqrt of the relative cost that doubles resolve
  }
}

TEST(RefineCameraMatrix, TenThousandProblemsWithoutNoise) {
  Rng rng(2);
  int good = 0, wrong = 0;
  for (int i = 0; i < 10000; ++i) {
    const Scene s = random_scene(rng, 12, 0);
    Mat34 start = s.P * (i % 2 ? -3 : 1);  // of any scale and sign
    for (int r = 0; r < 3; ++r) start.row(r) *= 1 + rng.uniform(-0.01, 0.01);
    const auto P = refine_camera_matrix(start, s.p_world, s.px, 1.0);
    if (!P) continue;
    const double error = (P->P - s.P).norm();  // the sign too: the truth has positive depths
    good += error < 1e-9;
    wrong += error > 1e-6;
  }
  EXPECT_GE(good, 9900);
  EXPECT_EQ(wrong, 0);
}

TEST(RefineCameraMatrix, OverAThousandTrialsTheCovarianceIsRight) {
  Rng rng(3);
  const Scene exact = random_scene(rng, 40, 0);
  const double sigma = 0.3;
  // Compared along a basis in which the rows of P weigh alike: pixels are 500 times the third row.
  const Vec12 p = detail::row_major<4>(exact.P);
  const Eigen::Matrix<double, 12, 11> B = detail::tangent_basis<12>(p);
  Vec11 mean = Vec11::Zero(), predicted = Vec11::Zero();
  double squared = 0, linear = 0, rms = 0;
  constexpr int kTrials = 1000;
  for (int i = 0; i < kTrials; ++i) {
    Scene s = exact;
    for (Vec2& px : s.px) {
      const double dx = rng.normal(sigma);
      px += Vec2(dx, rng.normal(sigma));
    }
    Mat34 start = camera_matrix(s.p_world, s.px).value();
    start /= start.norm();
    const auto found = refine_camera_matrix(start, s.p_world, s.px, sigma);
    ASSERT_TRUE(found);
    const Vec11 error = B.transpose() * (detail::row_major<4>(found->P) - p);
    const Eigen::Matrix<double, 11, 11> C = B.transpose() * found->covariance * B;
    const Vec11 e = C.diagonal().cwiseSqrt();
    const Eigen::Matrix<double, 11, 11> correlation =
        e.cwiseInverse().asDiagonal() * C * e.cwiseInverse().asDiagonal();
    const auto factor = correlation.ldlt();
    squared += error.cwiseQuotient(e).dot(factor.solve(error.cwiseQuotient(e))) / kTrials;
    const Vec11 start_error = (B.transpose() * (detail::row_major<4>(start) - p)).cwiseQuotient(e);
    linear += start_error.dot(factor.solve(start_error)) / kTrials;
    mean += error / kTrials;
    predicted += e / kTrials;
    rms += found->rms_px * found->rms_px / kTrials;
  }
  EXPECT_LT(mean.cwiseQuotient(predicted).cwiseAbs().maxCoeff(), 0.2);
  EXPECT_NEAR(squared, 11, 1.1);  // of 1,000: standard deviation 0.15
  EXPECT_LT(std::sqrt(linear / squared), 2) << "the closed form is a good start";
  EXPECT_NEAR(rms, sigma * sigma * (2 * 40 - 11) / 40, 0.03 * sigma * sigma * 2);
}

TEST(RefineCameraMatrix, TheCovarianceHasRankElevenAcrossP) {
  Rng rng(4);
  const Scene s = random_scene(rng, 30, 0.5);
  const Mat34 start = camera_matrix(s.p_world, s.px).value();
  const auto found = refine_camera_matrix(start, s.p_world, s.px, 0.5).value();
  EXPECT_NEAR(found.P.norm(), 1, 1e-14);
  EXPECT_LT((found.covariance * detail::row_major<4>(found.P)).norm(), 1e-12 * found.covariance.norm());
  EXPECT_LT((found.covariance - found.covariance.transpose()).norm(), 1e-14 * found.covariance.norm());
  EXPECT_GT(found.P.row(2).dot(s.p_world[0].homogeneous()), 0);
}

TEST(RefineCameraMatrix, RefusesCoplanarPointsAndATwistedCubicThroughTheCamera) {
  Rng rng(5);
  Scene plane = random_scene(rng, 0, 0), cubic{plane.P, {}, {}};
  const CameraMatrixParts parts = decompose_camera_matrix(plane.P).value();
  const Mat3 R = random_rotation(rng);
  for (int i = 0; i < 20; ++i) {
    const double x = rng.uniform(-0.3, 0.3), dx = rng.normal(0.5), dy = rng.normal(0.5);
    plane.p_world.push_back(R * Vec3(x, rng.uniform(-0.3, 0.3), 0.05));
    plane.px.push_back(image_of(plane.P, plane.p_world.back())->px + Vec2(dx, dy));
    const double t = 0.5 + 0.05 * i;
    cubic.p_world.push_back(parts.T_cam_world().inverse() * Vec3(0.3 * t * t, 0.3 * t * t * t, t));
    cubic.px.push_back(image_of(plane.P, cubic.p_world.back())->px);
  }
  for (const Scene& s : {plane, cubic}) {
    const auto P = refine_camera_matrix(s.P, s.p_world, s.px, 0.5);
    ASSERT_FALSE(P);
    EXPECT_EQ(P.error().code, ErrorCode::kDegenerate) << P.error().text();
    EXPECT_THAT(P.error().message, HasSubstr("do not determine the camera matrix"));
  }
}

TEST(RefineCameraMatrix, CallerBugsThrowAndNanIsInvalidData) {
  Rng rng(6);
  Scene s = random_scene(rng, 10, 0);
  EXPECT_THROW((void)refine_camera_matrix(s.P, std::span(s.p_world).first(5), std::span(s.px).first(5), 1),
               std::invalid_argument);
  EXPECT_THROW((void)refine_camera_matrix(s.P, s.p_world, s.px, 0), std::invalid_argument);
  EXPECT_EQ(refine_camera_matrix(Mat34::Zero(), s.p_world, s.px, 1).error().code, ErrorCode::kInvalidData);
  s.px[3].x() = std::nan("");
  EXPECT_EQ(refine_camera_matrix(s.P, s.p_world, s.px, 1).error().code, ErrorCode::kInvalidData);
}

}  // namespace
}  // namespace plumbline::test
