// SPDX-License-Identifier: Apache-2.0
// pose_linear() of linear/pose.hpp. Its noise is compared with the refined pose's in
// tests/refine/pose_test.cpp.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "linear/scenes.hpp"
#include "plumbline/linear/pose.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

struct Problem {
  SE3 T_cam_world;
  std::vector<Vec3> p_world, rays_cam;
};

// n points in a cube of 2 units, before a camera 2 to 4 units away that looks anywhere.
Problem random_problem(Rng& rng, int n) {
  Problem q{SE3(random_rotation(rng), Vec3::Zero()), {}, {}};
  const SE3 to_front(random_rotation(rng), random_direction(rng) * rng.uniform(2, 4));
  q.T_cam_world = q.T_cam_world * to_front;
  for (int k = 0; k < n; ++k) {
    q.p_world.push_back(random_vec3(rng, -1, 1));
    q.rays_cam.push_back((q.T_cam_world * q.p_world.back()).normalized());
  }
  return q;
}

TEST(PoseLinear, IsExactWithoutNoise) {
  Rng rng(1);
  std::vector<double> errors;
  for (int i = 0; i < 10000; ++i) {
    const Problem q = random_problem(rng, 8 + rng.index(8));
    const auto pose = pose_linear(q.p_world, q.rays_cam);
    ASSERT_TRUE(pose) << pose.error().text();
    errors.push_back(box_minus(*pose, q.T_cam_world).norm());
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[9900], 1e-9);
  EXPECT_LT(errors.back(), 1e-7);
}

TEST(PoseLinear, SixPointsSuffice) {
  Rng rng(2);
  int answers = 0;
  for (int i = 0; i < 200; ++i) {
    const Problem q = random_problem(rng, 6);
    const auto pose = pose_linear(q.p_world, q.rays_cam);
    if (!pose) continue;
    ++answers;
    EXPECT_LT(box_minus(*pose, q.T_cam_world).norm(), 1e-6) << "problem " << i;
  }
  EXPECT_GE(answers, 190);  // six points may come near a plane or a cubic
}

TEST(PoseLinear, RefusesWhatDoesNotDetermineAPose) {
  Rng rng(3);
  const Problem q = random_problem(rng, 9);
  const auto refused = [](const std::vector<Vec3>& p, const std::vector<Vec3>& rays) {
    const auto pose = pose_linear(p, rays);
    EXPECT_FALSE(pose);
    if (pose) return std::string();
    EXPECT_EQ(pose.error().code, ErrorCode::kDegenerate);
    return pose.error().message;
  };
  EXPECT_THAT(
      refused({q.p_world.begin(), q.p_world.begin() + 5}, {q.rays_cam.begin(), q.rays_cam.begin() + 5}),
      HasSubstr("5 points"));
  Problem flat = q, mirrored = q;
  for (std::size_t i = 0; i < 9; ++i) {
    flat.p_world[i].z() = 0.1;
    flat.rays_cam[i] = (q.T_cam_world * flat.p_world[i]).normalized();
    mirrored.p_world[i].x() = -q.p_world[i].x();
  }
  EXPECT_THAT(refused(flat.p_world, flat.rays_cam), HasSubstr("coplanar"));
  EXPECT_THAT(refused(mirrored.p_world, mirrored.rays_cam), HasSubstr("mirror image"));
  Problem broken = q;
  broken.p_world[2].x() = std::nan("");
  EXPECT_EQ(pose_linear(broken.p_world, broken.rays_cam).error().code, ErrorCode::kInvalidData);
  EXPECT_THROW((void)pose_linear(q.p_world, std::span(q.rays_cam).first(8)), std::invalid_argument);
}

}  // namespace
}  // namespace plumbline::test
