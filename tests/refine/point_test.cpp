// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/point.hpp"

#include <ceres/ceres.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "linear/scenes.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

Lens lens_of(std::string_view name, std::vector<double> k) { return make_lens(name, k).value(); }

struct Scene {
  std::vector<PosedLens> cameras;
  Vec3 p_world;
  std::vector<Vec2> px;  // without noise
};

// n cameras of different lenses on a baseline of 1.2 m, 1.5 to 4 m from the point.
Scene random_scene(Rng& rng, int n) {
  static const std::vector<Lens> lenses{
      lens_of("opencv5", {520, 530, 315, 243, -0.28, 0.1, 1e-3, -5e-4, -0.01}),
      lens_of("kb4", {300, 301, 319, 241, -0.012, 0.004, -0.0015, 2e-4}),
      lens_of("pinhole", {800, 810, 640, 480})};
  Scene s;
  const SE3 T_any_world(random_rotation(rng), random_vec3(rng, -30, 30));
  const Vec3 p = rng.uniform(1.5, 4) * Vec3(rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), 1);
  s.p_world = T_any_world.inverse() * p;
  while (static_cast<int>(s.px.size()) < n) {
    const Vec3 centre =
        random_vec3(rng, -0.1, 0.1) + Vec3(1.2 * static_cast<double>(s.px.size()) / (n - 1) - 0.6, 0, 0);
    const Mat3 R = so3_exp(0.2 * random_direction(rng));
    const SE3 T_cam_any(R, -R * centre);
    const Lens& lens = lenses[static_cast<std::size_t>(rng.index(3))];
    const auto px = project(lens, T_cam_any * p);
    if (!px) continue;
    s.cameras.push_back({lens, T_cam_any * T_any_world});
    s.px.push_back(*px);
  }
  return s;
}

std::vector<Vec2> noisy(const std::vector<Vec2>& px, Rng& rng, double sigma) {
  std::vector<Vec2> moved = px;
  for (Vec2& p : moved) p += sigma * Vec2(rng.normal(), rng.normal());
  return moved;
}

TEST(RefinePoint, IsExactWithoutNoise) {
  Rng rng(1);
  std::vector<double> errors;
  for (int i = 0; i < 10000; ++i) {
    const Scene s = random_scene(rng, 2 + rng.index(4));
    const auto refined = refine_point(s.p_world + 0.1 * random_direction(rng), s.cameras, s.px, 0.1);
    ASSERT_TRUE(refined) << refined.error().text();
    errors.push_back((refined->p_world - s.p_world).norm() / s.p_world.norm());
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[9900], 1e-9);
  EXPECT_LT(errors.back(), 1e-8);
}

// Over 1000 noisy trials, with two and with five views; and the linear point within 5 % of the refined one's
// error.
TEST(RefinePoint, StatesItsCovariance) {
  Rng rng(2);
  const double sigma = 0.2;
  for (const int views : {2, 5}) {
    Vec3 mean = Vec3::Zero();
    double mahalanobis = 0, linear_mahalanobis = 0, squares = 0;
    const int trials = 1000;
    for (int i = 0; i < trials; ++i) {
      const Scene s = random_scene(rng, views);
      const auto px = noisy(s.px, rng, sigma);
      const auto start = triangulate(s.cameras, px, sigma);
      ASSERT_TRUE(start) << start.error().text();
      const auto refined = refine_point(start->p_world, s.cameras, px, sigma);
      ASSERT_TRUE(refined) << refined.error().text();
      const Vec3 d = s.p_world - refined->p_world, d_linear = s.p_world - start->p_world;
      mean += d.cwiseQuotient(refined->covariance.diagonal().cwiseSqrt()) / trials;
      mahalanobis += d.dot(Vec3(*solve_spd(refined->covariance, d))) / trials;
      linear_mahalanobis += d_linear.dot(Vec3(*solve_spd(start->covariance, d_linear))) / trials;
      squares += refined->rms_px * refined->rms_px / trials;
      EXPECT_LE(refined->rms_px, start->rms_px * (1 + 1e-9));
    }
    EXPECT_LT(mean.cwiseAbs().maxCoeff(), 0.2) << views << " views";
    EXPECT_NEAR(mahalanobis, 3, 0.3) << views << " views";
    EXPECT_NEAR(linear_mahalanobis, 3, 0.3) << views << " views";
    // chi squared with 2 n - 3 degrees of freedom: its mean over 1000 has a deviation of sqrt(2 / (2 n - 3) /
    // 1000).
    const double expected = sigma * sigma * (2 * views - 3) / views;
    EXPECT_NEAR(squares, expected, 4 * std::sqrt(2.0 / (2 * views - 3) / trials) * expected)
        << views << " views";
  }
}

struct Reprojection {
  const PosedLens& camera;
  Vec2 px;
  template <class T>
  bool operator()(const T* p_world, T* r) const {
    return std::visit(
        [&]<class L>(const L& l) {
          if constexpr (FixedLens<L>) {
            const Mat3 R = camera.T_cam_world.R();
            const Vec3 t = camera.T_cam_world.t();
            T q[3], k[L::kNumParams];
            for (int i = 0; i < 3; ++i)
              q[i] = R(i, 0) * p_world[0] + R(i, 1) * p_world[1] + R(i, 2) * p_world[2] + t[i];
            for (int i = 0; i < L::kNumParams; ++i) k[i] = T((&l.fx)[i]);
            L::project_t(k, q, r);
            r[0] -= px.x();
            r[1] -= px.y();
          }
          return FixedLens<L>;
        },
        camera.lens);
  }
};

TEST(RefinePoint, ReachesCeresOptimumAndCovariance) {
  Rng rng(3);
  for (int i = 0; i < 30; ++i) {
    const Scene s = random_scene(rng, 2 + i % 4);
    const auto px = noisy(s.px, rng, 1);
    const auto ours = refine_point(s.p_world, s.cameras, px, 1).value();
    Vec3 p = s.p_world;
    ceres::Problem problem;
    for (std::size_t k = 0; k < px.size(); ++k) {
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<Reprojection, 2, 3>(new Reprojection{s.cameras[k], px[k]}), nullptr,
          p.data());
    }
    ceres::Solver::Options options;
    options.function_tolerance = 0, options.gradient_tolerance = 1e-14, options.parameter_tolerance = 1e-14;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    const double cost = 0.5 * ours.rms_px * ours.rms_px * static_cast<double>(px.size());
    EXPECT_NEAR(cost, summary.final_cost, 1e-9 * (1 + summary.final_cost)) << "problem " << i;
    ceres::Covariance covariance((ceres::Covariance::Options()));
    ASSERT_TRUE(covariance.Compute(std::vector<std::pair<const double*, const double*>>{{p.data(), p.data()}},
                                   &problem));
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> C;
    covariance.GetCovarianceBlock(p.data(), p.data(), C.data());
    EXPECT_LT((C - ours.covariance).norm(), 1e-4 * C.norm()) << "problem " << i;
  }
}

// Two pinholes: the minimum has a closed form, by another road. The linear points are within twice its error.
TEST(RefinePoint, IsThePointOfHartleyAndSturm) {
  Rng rng(4);
  const Lens lens = lens_of("pinhole", {800, 810, 640, 480});
  const Mat3 K = camera_matrix_k(lens);
  double refined_2 = 0, linear_2 = 0, midpoint_2 = 0, rays_2 = 0;
  for (int i = 0; i < 1000; ++i) {
    const SE3 T_2_1(so3_exp(0.2 * random_direction(rng)), Vec3(-0.6, 0.1, rng.uniform(-0.3, 0.3)));
    const Vec3 p = rng.uniform(1.5, 4) * Vec3(rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), 1);
    const std::vector<PosedLens> two{{lens, SE3()}, {lens, T_2_1}};
    const std::vector<Mat34> P{K * SE3().matrix34(), K * T_2_1.matrix34()};
    const auto px = noisy({*project(lens, p), *project(lens, T_2_1 * p)}, rng, 0.5);
    const Vec3 refined = refine_point(p, two, px, 0.5)->p_world;
    const Vec3 optimal = triangulate_optimal(P[0], P[1], px[0], px[1])->hnormalized();
    EXPECT_LT((refined - optimal).norm(), 1e-6 * p.norm()) << "problem " << i;
    const std::vector<WorldRay> rays{{Vec3::Zero(), *unproject(lens, px[0])},
                                     {T_2_1.centre(), T_2_1.R().transpose() * *unproject(lens, px[1])}};
    refined_2 += (refined - p).squaredNorm();
    rays_2 += (triangulate(two, px, 0.5)->p_world - p).squaredNorm();
    linear_2 += (triangulate_linear(P, px)->hnormalized() - p).squaredNorm();
    midpoint_2 += (triangulate_midpoint(rays).value() - p).squaredNorm();
  }
  EXPECT_LT(rays_2, 1.01 * refined_2);
  EXPECT_LT(linear_2, 4 * refined_2);
  EXPECT_LT(midpoint_2, 4 * refined_2);
}

TEST(RefinePoint, RefusesByName) {
  const Lens lens = lens_of("pinhole", {800, 810, 640, 480});
  const SE3 left, right(Mat3::Identity(), Vec3(-0.1, 0, 0));
  const std::vector<PosedLens> two{{lens, left}, {lens, right}};
  const auto expect = [&](const Vec3& start, const Vec3& truth, double sigma, ErrorCode code,
                          const char* text) {
    const std::vector<Vec2> px{*project(lens, left * truth), *project(lens, right * truth)};
    const auto refined = refine_point(start, two, px, sigma);
    ASSERT_FALSE(refined);
    EXPECT_EQ(refined.error().code, code) << refined.error().text();
    EXPECT_THAT(refined.error().message, HasSubstr(text));
  };
  expect(Vec3(0, 0, 39), Vec3(0, 0, 40), 0.5, ErrorCode::kDegenerate,
         "parallel");  // see triangulate_test: 28 m
  expect(Vec3(0, 0, -1), Vec3(0, 0, 3), 0.5, ErrorCode::kInvalidData, "does not see the start");
  EXPECT_THROW((void)refine_point(Vec3(0, 0, 1), two, std::vector<Vec2>(1), 0.5), std::invalid_argument);
}

}  // namespace
}  // namespace plumbline::test
