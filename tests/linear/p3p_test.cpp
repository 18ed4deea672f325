// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/p3p.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <opencv2/calib3d.hpp>

#include "linear/scenes.hpp"

namespace plumbline::test {
namespace {

struct Problem {
  SE3 T_cam_world;
  std::array<Vec3, 3> p_world, rays_cam;
};

// Three points in a cube of 2 units before a camera 2 to 4 units away.
Problem random_problem(Rng& rng) {
  Problem q{SE3(random_rotation(rng), random_vec3(rng, -1, 1)), {}, {}};
  const Vec3 centre(0, 0, rng.uniform(2, 4));
  for (int k = 0; k < 3; ++k) {
    const Vec3 p_cam = centre + random_vec3(rng, -1, 1);
    q.p_world[k] = q.T_cam_world.inverse() * p_cam;
    q.rays_cam[k] = p_cam.normalized();
  }
  return q;
}

double nearest(const P3pSolutions& solutions, const SE3& T) {
  double least = 1e9;
  for (const SE3& s : solutions) least = std::min(least, box_minus(s, T).norm());
  return least;
}

double worst_ray(const SE3& T, const Problem& q) {
  double worst = 0;
  for (int k = 0; k < 3; ++k) {
    worst = std::max(worst, ((T * q.p_world[k]).normalized() - q.rays_cam[k]).norm());
  }
  return worst;
}

TEST(P3p, FindsTheTruthAndReturnsSolutionsOnly) {
  Rng rng(1);
  std::vector<double> errors;
  for (int i = 0; i < 10000; ++i) {
    const Problem q = random_problem(rng);
    const P3pSolutions solutions = p3p(q.p_world, q.rays_cam);
    errors.push_back(nearest(solutions, q.T_cam_world));
    for (const SE3& T : solutions) ASSERT_LT(worst_ray(T, q), 1e-10) << "problem " << i;
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[9900], 1e-9);
  // Near the danger cylinder an answer moves by the square root of rounding.
  EXPECT_LT(errors.back(), 1e-6);
}

TEST(P3p, WorksOnRaysBehindTheCamera) {
  Rng rng(2);
  for (int i = 0; i < 1000; ++i) {
    Problem q = random_problem(rng);
    // The same rays in a camera that looks elsewhere.
    const SE3 turn(random_rotation(rng), Vec3::Zero());
    for (Vec3& ray : q.rays_cam) ray = turn * ray;
    EXPECT_LT(nearest(p3p(q.p_world, q.rays_cam), turn * q.T_cam_world), 1e-6) << "problem " << i;
  }
}

// The example of Fischler & Bolles (1981), figure 5: an equilateral triangle of side 2 sqrt(3) whose corners
// are seen at angles of cosine 5/8 has four poses, with distances (4, 4, 4), (1, 4, 4), (4, 1, 4) and (4, 4,
// 1).
TEST(P3p, FindsTheFourPosesOfFischlerAndBolles) {
  std::array<Vec3, 3> p, rays;
  // Three rays around z at angle a: cos of their mutual angle is cos^2 a - sin^2 a / 2 = 1 - 1.5 sin^2 a.
  const double s = std::sqrt((1 - 5.0 / 8) / 1.5), c = std::sqrt(1 - s * s);
  for (int k = 0; k < 3; ++k) {
    const double phi = 2 * std::numbers::pi / 3 * k;
    p[k] = 2 * Vec3(std::cos(phi), std::sin(phi), 0);
    rays[k] = Vec3(s * std::cos(phi), s * std::sin(phi), c);
  }
  const P3pSolutions solutions = p3p(p, rays);
  ASSERT_EQ(solutions.size(), 4u);
  std::vector<Vec3> distances{{4, 4, 4}, {1, 4, 4}, {4, 1, 4}, {4, 4, 1}};
  for (const Vec3& expected : distances) {
    double least = 1e9;
    for (const SE3& T : solutions) {
      const Vec3 l((T * p[0]).norm(), (T * p[1]).norm(), (T * p[2]).norm());
      least = std::min(least, (l - expected).norm());
    }
    EXPECT_LT(least, 1e-7) << expected.transpose();
  }
}

TEST(P3p, FindsWhatOpenCVFinds) {
  Rng rng(3);
  const cv::Mat K = cv::Mat::eye(3, 3, CV_64F);
  int same = 0;
  const int trials = 500;
  for (int i = 0; i < trials; ++i) {
    const Problem q = random_problem(rng);
    std::vector<cv::Point3d> object;
    std::vector<cv::Point2d> image;
    for (int k = 0; k < 3; ++k) {
      object.emplace_back(q.p_world[k].x(), q.p_world[k].y(), q.p_world[k].z());
      image.emplace_back(q.rays_cam[k].x() / q.rays_cam[k].z(), q.rays_cam[k].y() / q.rays_cam[k].z());
    }
    std::vector<cv::Mat> r, t;
    const int n = cv::solveP3P(object, image, K, cv::noArray(), r, t, cv::SOLVEPNP_P3P);
    const P3pSolutions ours = p3p(q.p_world, q.rays_cam);
    bool all = static_cast<int>(ours.size()) == n;
    for (int k = 0; k < n; ++k) {
      const SE3 theirs(so3_exp(Vec3(r[k].ptr<double>())), Vec3(t[k].ptr<double>()));
      all = all && nearest(ours, theirs) < 1e-3;  // theirs is not polished
    }
    same += all;
  }
  EXPECT_GE(same, trials * 98 / 100);  // OpenCV loses the truth in 0.8 %
}

// The camera on the cylinder through the triangle's circumscribed circle, along its normal: two solutions
// meet.
TEST(P3p, SurvivesTheDangerCylinder) {
  Rng rng(4);
  int found = 0;
  for (int i = 0; i < 1000; ++i) {
    Problem q;
    for (int k = 0; k < 3; ++k) {
      const double phi = rng.uniform(0, 6.283);
      q.p_world[k] = Vec3(std::cos(phi), std::sin(phi), 0);
    }
    const double phi = rng.uniform(0, 6.283);
    const Mat3 R = random_rotation(rng);
    q.T_cam_world = SE3(R, -R * Vec3(std::cos(phi), std::sin(phi), rng.uniform(1, 3)));
    for (int k = 0; k < 3; ++k) q.rays_cam[k] = (q.T_cam_world * q.p_world[k]).normalized();
    const P3pSolutions solutions = p3p(q.p_world, q.rays_cam);
    for (const SE3& T : solutions) ASSERT_LT(worst_ray(T, q), 1e-7);
    found += nearest(solutions, q.T_cam_world) < 1e-3;
  }
  EXPECT_GT(found, 950);  // the rest are triangles of nearly no area, or lost to rounding: no wrong answer
}

TEST(P3p, ReturnsNothingForWhatHasNoAnswer) {
  Rng rng(5);
  Problem q = random_problem(rng);
  const auto with = [&](const Vec3& third) {
    return p3p(std::array<Vec3, 3>{q.p_world[0], q.p_world[1], third}, q.rays_cam);
  };
  EXPECT_FALSE(with(q.p_world[2]).empty());
  EXPECT_TRUE(with(q.p_world[0] + 0.3 * (q.p_world[1] - q.p_world[0])).empty());
  EXPECT_TRUE(with(q.p_world[0]).empty());
  EXPECT_TRUE(with(Vec3::Constant(std::nan(""))).empty());
  q.rays_cam[1] = Vec3::Constant(std::nan(""));
  EXPECT_TRUE(p3p(q.p_world, q.rays_cam).empty());
  EXPECT_THROW(P3pSolutions()[0], std::invalid_argument);
}

}  // namespace
}  // namespace plumbline::test
