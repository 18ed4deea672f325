// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/pose.hpp"

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>
#include <opencv2/calib3d.hpp>

#include "linear/scenes.hpp"
#include "plumbline/core/linalg.hpp"
#include "plumbline/linear/pose.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

Lens lens_of(std::string_view name, std::vector<double> k) { return make_lens(name, k).value(); }

struct Case {
  const char* name;
  Lens lens;
  double spread;  // of the points, tangent of the angle off the axis; wide: the rig of all directions
};
const std::vector<Case>& cases() {
  static const std::vector<Case> all{
      {"pinhole", lens_of("pinhole", {520, 530, 315, 243}), 0.5},
      {"opencv5", lens_of("opencv5", {520, 530, 315, 243, -0.28, 0.1, 1e-3, -5e-4, -0.01}), 0.5},
      {"opencv8", lens_of("opencv8", {520, 530, 315, 243, 0.2, -0.1, 1e-3, -5e-4, 0.02, 0.5, -0.05, 0.03}),
       0.5},
      {"kb4_190_degrees", lens_of("kb4", {180, 181, 319, 241, -0.012, 0.004, -0.0015, 2e-4}), 20}};
  return all;
}

struct Scene {
  SE3 T_cam_world;
  std::vector<Vec3> p_world;
  std::vector<Vec2> px;  // without noise
};

// n points 1 to 3 m away, far from the world's origin.
Scene random_scene(const Case& c, Rng& rng, int n) {
  Scene s{SE3(random_rotation(rng), random_vec3(rng, -20, 20)), {}, {}};
  while (static_cast<int>(s.px.size()) < n) {
    const Vec3 direction = Vec3(c.spread * rng.uniform(-1, 1), c.spread * rng.uniform(-1, 1), 1).normalized();
    const Vec3 p_cam = rng.uniform(1, 3) * direction;
    const auto px = project(c.lens, p_cam);
    if (!px) continue;
    s.p_world.push_back(s.T_cam_world.inverse() * p_cam);
    s.px.push_back(*px);
  }
  return s;
}

std::vector<Vec2> noisy(const std::vector<Vec2>& px, Rng& rng, double sigma) {
  std::vector<Vec2> moved = px;
  for (Vec2& p : moved) p += sigma * Vec2(rng.normal(), rng.normal());
  return moved;
}

SE3 nudged(const SE3& T, Rng& rng, double size) {
  Vec6 d;
  for (double& x : d) x = rng.normal(size);
  return box_plus(T, d);
}

class RefinePose : public ::testing::TestWithParam<std::size_t> {
 protected:
  const Case& c = cases()[GetParam()];
};

TEST_P(RefinePose, IsExactWithoutNoise) {
  Rng rng(1);
  std::vector<double> errors;
  for (int i = 0; i < 2500; ++i) {  // 10 000 over the lenses
    const Scene s = random_scene(c, rng, 8);
    // Moved about the points, not about a world's origin 20 m away.
    const SE3 about(Mat3::Identity(), s.T_cam_world.centre());
    const auto refined =
        refine_pose(nudged(s.T_cam_world * about, rng, 0.01) * about.inverse(), c.lens, s.p_world, s.px, 1);
    ASSERT_TRUE(refined) << refined.error().text();
    errors.push_back(box_minus(refined->T_cam_world, s.T_cam_world).norm() / s.T_cam_world.t().norm());
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[2475], 1e-9);
  EXPECT_LT(errors.back(), 1e-7);
}

// Over 1000 noisy trials the error's mean and its Mahalanobis square are those of the stated covariance.
TEST_P(RefinePose, StatesItsCovariance) {
  Rng rng(2);
  const double sigma = 0.3;
  const int trials = 1000;
  Vec6 mean = Vec6::Zero();
  double mahalanobis = 0, squares = 0;
  for (int i = 0; i < trials; ++i) {
    const Scene s = random_scene(c, rng, 30);
    const auto refined = refine_pose(s.T_cam_world, c.lens, s.p_world, noisy(s.px, rng, sigma), sigma);
    ASSERT_TRUE(refined) << refined.error().text();
    const Vec6 d = box_minus(s.T_cam_world, refined->T_cam_world);
    const Vec6 in_sigmas = d.cwiseQuotient(refined->covariance.diagonal().cwiseSqrt());
    mean += in_sigmas / trials;
    mahalanobis += d.dot(Vec6(*solve_spd(refined->covariance, d))) / trials;
    squares += refined->rms_px * refined->rms_px / trials;
  }
  EXPECT_LT(mean.cwiseAbs().maxCoeff(), 0.2);
  EXPECT_NEAR(mahalanobis, 6, 0.6);
  EXPECT_NEAR(squares, sigma * sigma * (60 - 6) / 30, 0.02 * sigma * sigma * 2);
}

struct Reprojection {
  const Lens& lens;
  Vec3 p_world;
  Vec2 px;
  template <class T>
  bool operator()(const T* pose, T* r) const {  // angle-axis, translation
    return std::visit(
        [&]<class L>(const L& l) {
          if constexpr (FixedLens<L>) {
            const T p[3] = {T(p_world[0]), T(p_world[1]), T(p_world[2])};
            T q[3], k[L::kNumParams];
            ceres::AngleAxisRotatePoint(pose, p, q);
            for (int i = 0; i < 3; ++i) q[i] += pose[3 + i];
            for (int i = 0; i < L::kNumParams; ++i) k[i] = T((&l.fx)[i]);
            L::project_t(k, q, r);
            r[0] -= px.x();
            r[1] -= px.y();
          }
          return FixedLens<L>;
        },
        lens);
  }
};

TEST_P(RefinePose, ReachesCeresOptimumAndCovariance) {
  Rng rng(3);
  for (int i = 0; i < 10; ++i) {
    const Scene s = random_scene(c, rng, 20);
    const auto px = noisy(s.px, rng, 0.5);
    const auto ours = refine_pose(s.T_cam_world, c.lens, s.p_world, px, 1).value();
    Vec6 start;
    start << so3_log(s.T_cam_world.R()), s.T_cam_world.t();
    double* pose = start.data();
    ceres::Problem problem;
    for (std::size_t k = 0; k < px.size(); ++k) {
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<Reprojection, 2, 6>(new Reprojection{c.lens, s.p_world[k], px[k]}),
          nullptr, pose);
    }
    ceres::Solver::Options options;
    options.function_tolerance = 0, options.gradient_tolerance = 1e-14, options.parameter_tolerance = 1e-14;
    options.max_num_iterations = 200;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    const double cost = 0.5 * ours.rms_px * ours.rms_px * 20;
    EXPECT_NEAR(cost, summary.final_cost, 1e-9 * summary.final_cost) << "problem " << i;
    ceres::Covariance::Options covariance_options;
    covariance_options.algorithm_type = ceres::DENSE_SVD;
    ceres::Covariance covariance(covariance_options);
    ASSERT_TRUE(
        covariance.Compute(std::vector<std::pair<const double*, const double*>>{{pose, pose}}, &problem));
    Eigen::Matrix<double, 6, 6, Eigen::RowMajor> C;
    covariance.GetCovarianceBlock(pose, pose, C.data());
    Mat6 J = Mat6::Identity();  // rotation vector to step on the left
    J.topLeftCorner<3, 3>() = so3_left_jacobian(Vec3(pose));
    EXPECT_LT((J * C * J.transpose() - ours.covariance).norm(), 1e-4 * ours.covariance.norm())
        << "problem " << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Lens, RefinePose, ::testing::Range(std::size_t(0), cases().size()),
                         [](const auto& info) { return std::string(cases()[info.param].name); });

TEST(RefinePoseOfPinhole, IsNoWorseThanSolvePnP) {
  Rng rng(4);
  const Case& c = cases()[1];
  const cv::Mat K = (cv::Mat_<double>(3, 3) << 520, 0, 315, 0, 530, 243, 0, 0, 1);
  const std::vector<double> distortion{-0.28, 0.1, 1e-3, -5e-4, -0.01};
  for (int i = 0; i < 50; ++i) {
    const Scene s = random_scene(c, rng, 20);
    const auto px = noisy(s.px, rng, 0.5);
    std::vector<cv::Point3d> object;
    std::vector<cv::Point2d> image;
    for (std::size_t k = 0; k < px.size(); ++k) {
      object.emplace_back(s.p_world[k].x(), s.p_world[k].y(), s.p_world[k].z());
      image.emplace_back(px[k].x(), px[k].y());
    }
    const auto ours = refine_pose(s.T_cam_world, c.lens, s.p_world, px, 0.5).value();
    for (const int method : {cv::SOLVEPNP_ITERATIVE, cv::SOLVEPNP_EPNP, cv::SOLVEPNP_SQPNP}) {
      cv::Mat r, t;
      ASSERT_TRUE(cv::solvePnP(object, image, K, distortion, r, t, false, method));
      const SE3 theirs(so3_exp(Vec3(r.ptr<double>())), Vec3(t.ptr<double>()));
      double sum = 0;
      bool seen = true;
      for (std::size_t k = 0; k < px.size(); ++k) {
        const auto q = project(c.lens, theirs * s.p_world[k]);
        if (q) sum += (*q - px[k]).squaredNorm();
        seen = seen && q;
      }
      if (!seen) continue;
      EXPECT_LE(ours.rms_px, std::sqrt(sum / 20) * (1 + 1e-9)) << "method " << method;
      // OpenCV's iteration stops at a step of 1.2e-7.
      if (method == cv::SOLVEPNP_ITERATIVE) EXPECT_NEAR(ours.rms_px, std::sqrt(sum / 20), 1e-4);
    }
  }
}

// pose_linear() has at most twice the error of the refined pose (and far less than a bare DLT).
TEST(RefinePoseOfPinhole, TheLinearPoseIsWithinTwiceItsError) {
  Rng rng(5);
  const Case& c = cases()[0];
  for (const int n : {8, 20, 60}) {
    Vec6 linear = Vec6::Zero(), refined = Vec6::Zero();
    for (int i = 0; i < 1000; ++i) {
      const Scene s = random_scene(c, rng, n);
      const SE3 T = s.T_cam_world;
      const auto px = noisy(s.px, rng, 0.3);
      std::vector<Vec3> rays;
      for (const Vec2& p : px) rays.push_back(*unproject(c.lens, p));
      const SE3 about(Mat3::Identity(), T.centre());
      const auto error = [&](const SE3& other) { return box_minus(other * about, T * about).cwiseAbs2(); };
      linear += error(pose_linear(s.p_world, rays).value()) / 1000;
      refined += error(refine_pose(T, c.lens, s.p_world, px, 0.3)->T_cam_world) / 1000;
    }
    const Vec6 ratio = linear.cwiseQuotient(refined).cwiseSqrt();
    EXPECT_LT(ratio.maxCoeff(), 2) << n << " points: " << ratio.transpose();
  }
}

// The better pose of a board likewise.
TEST(RefinePoseOfPinhole, ThePlanarPoseIsWithinTwiceItsError) {
  Rng rng(6);
  const Case& c = cases()[0];
  const auto points = on_plane(grid(7, 5, 0.04));
  Vec6 planar = Vec6::Zero(), refined = Vec6::Zero();
  for (int i = 0; i < 500; ++i) {
    const SE3 T = random_board_pose(rng, rng.uniform(0.4, 0.8), rng.uniform(0.4, 0.9));
    std::vector<Vec3> rays;
    std::vector<Vec2> px;
    for (const Vec3& p : points) {
      px.push_back(*project(c.lens, T * p) + 0.2 * Vec2(rng.normal(), rng.normal()));
      rays.push_back(*unproject(c.lens, px.back()));
    }
    planar += box_minus(pose_planar(points, rays)->best.T_cam_board, T).cwiseAbs2();
    refined += box_minus(refine_pose(T, c.lens, points, px, 0.2)->T_cam_world, T).cwiseAbs2();
  }
  EXPECT_LT(planar.cwiseQuotient(refined).cwiseSqrt().maxCoeff(), 1.2);  // angles weigh the rim a little less
}

TEST(RefinePoseOfPinhole, RefusesByName) {
  Rng rng(7);
  const Case& c = cases()[0];
  const Scene s = random_scene(c, rng, 12);
  const auto expect = [&](std::vector<Vec3> p, std::vector<Vec2> px, ErrorCode code, const char* text) {
    const auto refined = refine_pose(s.T_cam_world, c.lens, p, px, 0.5);
    ASSERT_FALSE(refined);
    EXPECT_EQ(refined.error().code, code);
    EXPECT_THAT(refined.error().message, HasSubstr(text));
  };
  expect({s.p_world.begin(), s.p_world.begin() + 2}, {s.px.begin(), s.px.begin() + 2}, ErrorCode::kDegenerate,
         "2 points");
  std::vector<Vec3> line, behind = s.p_world;
  std::vector<Vec2> line_px, broken = s.px;
  for (int i = 0; i < 10; ++i) {
    line.push_back(s.T_cam_world.inverse() * Vec3(0.05 * i - 0.2, 0.03 * i, 2 + 0.02 * i));
    line_px.push_back(*project(c.lens, s.T_cam_world * line.back()));
  }
  expect(line, line_px, ErrorCode::kDegenerate, "lie on a line");
  for (Vec2& px : line_px) px += 0.5 * Vec2(rng.normal(), rng.normal());
  expect(line, line_px, ErrorCode::kDegenerate, "lie on a line");
  behind[4] = s.T_cam_world.inverse() * Vec3(0, 0, -1);
  expect(behind, s.px, ErrorCode::kInvalidData, "1 of 12 points (the first is number 4");
  broken[2].x() = std::nan("");
  expect(s.p_world, broken, ErrorCode::kInvalidData, "number 2");
  EXPECT_THROW((void)refine_pose(s.T_cam_world, c.lens, s.p_world, s.px, 0), std::invalid_argument);
  EXPECT_THROW((void)refine_pose(s.T_cam_world, c.lens, line, s.px, 1), std::invalid_argument);
}

}  // namespace
}  // namespace plumbline::test
