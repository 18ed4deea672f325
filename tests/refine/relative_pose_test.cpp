// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/relative_pose.hpp"

#include <ceres/ceres.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "linear/two_views.hpp"
#include "plumbline/linear/essential.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

struct Views {
  Lens lens_1, lens_2;
  SE3 T_2_1;
  std::vector<Vec3> p_1;
  std::vector<Vec2> px1, px2;
};

// A pair of pinholes, of lenses with distortion, or of fisheyes that see 100 degrees off their axes.
Views views(Rng& rng, int n, int kind, double from_epipole = 0) {
  Views s;
  if (kind == 0) {
    s.lens_1 = Pinhole{600, 610, 320, 240};
    s.lens_2 = Pinhole{650, 640, 310, 250};
  } else if (kind == 1) {
    OpenCV5 lens = OpenCV5::seed({640, 480}, 500);
    lens.d[0] = -0.25, lens.d[1] = 0.08, lens.d[2] = 0.001;
    s.lens_1 = s.lens_2 = lens;
  } else {
    KannalaBrandt4 lens = KannalaBrandt4::seed({640, 480}, 150);
    lens.k1 = 0.02;
    s.lens_1 = s.lens_2 = lens;
  }
  const double cos_edge = kind == 2 ? -0.15 : 0.87;
  s.T_2_1 = SE3(so3_exp(rng.uniform(0.05, 0.3) * random_direction(rng)), random_direction(rng));
  while (static_cast<int>(s.p_1.size()) < n) {
    const Vec3 ray = random_direction(rng);
    if (ray.z() < cos_edge) continue;
    const Vec3 p = rng.uniform(3, 8) * ray, q = s.T_2_1 * p;
    if (q.z() < cos_edge * q.norm()) continue;
    // Within some sigmas of an epipole the constraint is bent, for any estimator: see NoiseIsPredicted.
    if (Vec3(q.normalized()).cross(s.T_2_1.t()).norm() < from_epipole ||
        Vec3(ray).cross(s.T_2_1.centre()).norm() < from_epipole) {
      continue;
    }
    const auto a = project(s.lens_1, p), b = project(s.lens_2, q);
    if (!a || !b) continue;
    s.p_1.push_back(p), s.px1.push_back(*a), s.px2.push_back(*b);
  }
  return s;
}

Views with_noise(Rng& rng, Views s, double sigma) {
  for (Vec2& p : s.px1) p = noisy(rng, p, sigma);
  for (Vec2& p : s.px2) p = noisy(rng, p, sigma);
  return s;
}

std::vector<Vec3> rays_of(const Lens& lens, const std::vector<Vec2>& px) {
  std::vector<Vec3> out;
  for (const Vec2& p : px) out.push_back(unproject(lens, p).value());
  return out;
}

Vec6 off_by(Rng& rng, double size) {
  Vec6 d;
  for (double& x : d) x = rng.normal(size);
  return d;
}

// A ray and its derivative along the pixel, by central differences: rounding leaves 1e-11 of it.
struct Ray {
  Vec3 v;
  Eigen::Matrix<double, 3, 2> J;
  Ray(const Lens& lens, const Vec2& px) : v(unproject(lens, px).value()) {
    constexpr double h = 1e-3;
    for (int k = 0; k < 2; ++k) {
      const Vec2 d = h * Vec2::Unit(k);
      const auto at = [&](double n) { return unproject(lens, px + n * d).value(); };
      J.col(k) = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * h);
    }
  }
};

// Over [Cayley's vector of a turn | t of any length]: another chart, and derivatives by Ceres.
struct RayCost {
  Mat3 R0;
  Ray a, b;
  template <class T>
  bool operator()(const T* w, const T* t, T* r) const {
    using V = Eigen::Matrix<T, 3, 1>;
    using M = Eigen::Matrix<T, 3, 3>;
    M X, S;
    X << T(0), -w[2], w[1], w[2], T(0), -w[0], -w[1], w[0], T(0);
    S << T(0), -t[2], t[1], t[2], T(0), -t[0], -t[1], t[0], T(0);
    const M I = M::Identity();
    const M E = S * (I - X).inverse() * (I + X) * R0.cast<T>();
    const V Ea = E * a.v.cast<T>(), Eb = E.transpose() * b.v.cast<T>();
    const Eigen::Matrix<T, 2, 1> s1 = a.J.transpose().cast<T>() * Eb, s2 = b.J.transpose().cast<T>() * Ea;
    r[0] = b.v.cast<T>().dot(Ea) / sqrt(s1.squaredNorm() + s2.squaredNorm());
    return true;
  }
};

TEST(RefineRelativePose, ReachesCeresOptimum) {
  Rng rng(1);
  for (int i = 0; i < 30; ++i) {
    const Views s = with_noise(rng, views(rng, 40, i % 3), 0.5);
    const auto refined =
        refine_relative_pose(box_plus(s.T_2_1, off_by(rng, 0.02)), s.lens_1, s.lens_2, s.px1, s.px2, 1);
    ASSERT_TRUE(refined) << refined.error().text();
    Vec3 w = Vec3::Zero(), t = s.T_2_1.t();
    ceres::Problem problem;
    for (std::size_t k = 0; k < s.px1.size(); ++k) {
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<RayCost, 1, 3, 3>(new RayCost{
                                   s.T_2_1.R(), Ray(s.lens_1, s.px1[k]), Ray(s.lens_2, s.px2[k])}),
                               nullptr, w.data(), t.data());
    }
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    options.max_num_iterations = 200;
    options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 1e-16;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    const double theirs = 2 * summary.final_cost, ours = 40 * refined->rms_px * refined->rms_px;
    EXPECT_NEAR(ours, theirs, 1e-9 * theirs);
    EXPECT_LT(std::abs(std::abs(refined->T_2_1.t().dot(t.normalized())) - 1), 1e-8);
  }
}

TEST(RefineRelativePose, ExactWithoutNoise) {
  Rng rng(2);
  for (int kind : {0, 1, 2}) {
    for (int i = 0; i < 100; ++i) {
      const Views s = views(rng, 30, kind);
      const auto refined =
          refine_relative_pose(box_plus(s.T_2_1, off_by(rng, 0.03)), s.lens_1, s.lens_2, s.px1, s.px2, 1);
      ASSERT_TRUE(refined) << refined.error().text();
      EXPECT_LT(box_minus(refined->T_2_1, s.T_2_1).norm(), 1e-9) << kind;
      EXPECT_NEAR(refined->T_2_1.t().norm(), 1, 1e-12);
    }
  }
}

TEST(RefineRelativePose, NoiseIsPredicted) {
  constexpr int kTrials = 1000, kPairs = 100;
  for (const int kind : {0, 1, 2}) {
    Rng rng(3 + static_cast<std::uint64_t>(kind));
    const double sigma = kind == 2 ? 0.5 : 1;  // a fisheye's pixel is four times as wide
    // Nearer than about 20 sigma to an epipole the constraint bends within the noise, and the covariance,
    // which is one of first order, is too small for the gold standard's answers just as well.
    const Views clean = views(rng, kPairs, kind, 20 * sigma / (kind == 2 ? 150 : 500));
    double squared = 0, linear2 = 0, refined2 = 0;
    Vec6 bias = Vec6::Zero(), sigma2 = Vec6::Zero();
    for (int i = 0; i < kTrials; ++i) {
      const Views s = with_noise(rng, clean, sigma);
      const auto a = rays_of(s.lens_1, s.px1), b = rays_of(s.lens_2, s.px2);
      const auto E = essential_8point(a, b);
      ASSERT_TRUE(E) << E.error().text();
      const auto start = relative_pose_from_essential(*E, a, b);
      ASSERT_TRUE(start) << start.error().text();
      const auto refined = refine_relative_pose(start->T_2_1, s.lens_1, s.lens_2, s.px1, s.px2, sigma);
      ASSERT_TRUE(refined) << refined.error().text();
      const Vec6 error = box_minus(refined->T_2_1, clean.T_2_1);
      const Eigen::SelfAdjointEigenSolver<Mat6> eigen(refined->covariance);
      const Vec6 e = eigen.eigenvectors().transpose() * error;
      squared += e.tail<5>().cwiseAbs2().cwiseQuotient(eigen.eigenvalues().tail<5>()).sum() / kTrials;
      EXPECT_LT(eigen.eigenvalues()[0], 1e-10 * eigen.eigenvalues()[1]);  // rank 5
      bias += error / kTrials, sigma2 += refined->covariance.diagonal() / kTrials;
      linear2 += box_minus(start->T_2_1, clean.T_2_1).squaredNorm(), refined2 += error.squaredNorm();
    }
    EXPECT_NEAR(squared, 5, 0.5) << kind;  // the standard deviation of the mean is 0.1
    for (int k = 0; k < 6; ++k) EXPECT_LT(std::abs(bias[k]), 0.2 * std::sqrt(sigma2[k])) << kind << " " << k;
    EXPECT_LT(std::sqrt(linear2 / refined2), 2) << kind;
  }
}

TEST(RefineRelativePose, RefusesBadInput) {
  Rng rng(7);
  Views s = views(rng, 10, 2);
  const auto still = refine_relative_pose(SE3(), s.lens_1, s.lens_2, s.px1, s.px2, 1);
  ASSERT_FALSE(still);
  EXPECT_THAT(still.error().message, HasSubstr("no baseline"));
  EXPECT_THROW((void)refine_relative_pose(s.T_2_1, s.lens_1, s.lens_2, s.px1, s.px2, -1),
               std::invalid_argument);
  s.px2[4] = Vec2(9000, 0);
  const auto outside = refine_relative_pose(s.T_2_1, s.lens_1, s.lens_2, s.px1, s.px2, 1);
  ASSERT_FALSE(outside);
  EXPECT_THAT(outside.error().message, HasSubstr("pair 4"));
}

}  // namespace
}  // namespace plumbline::test
