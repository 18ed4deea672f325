// SPDX-License-Identifier: Apache-2.0
// pose_planar() of linear/pose.hpp.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <opencv2/calib3d.hpp>

#include "linear/scenes.hpp"
#include "plumbline/linear/pose.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

std::vector<Vec3> rays_to(const SE3& T, const std::vector<Vec3>& points, Rng* rng = nullptr,
                          double sigma = 0) {
  std::vector<Vec3> rays;
  for (const Vec3& p : points) {
    Vec3 ray = (T * p).normalized();
    if (rng) ray += sigma * Vec3(rng->normal(), rng->normal(), rng->normal());
    rays.push_back(ray.normalized());
  }
  return rays;
}

double cost(const SE3& T, const std::vector<Vec3>& points, const std::vector<Vec3>& rays) {
  double sum = 0;
  for (std::size_t i = 0; i < points.size(); ++i)
    sum += ((T * points[i]).normalized() - rays[i]).squaredNorm();
  return sum;
}

TEST(PosePlanar, TheBestIsExactWithoutNoise) {
  Rng rng(1);
  std::vector<double> errors;
  for (int i = 0; i < 10000; ++i) {
    // A board that lies anywhere in its frame, before a camera that looks anywhere.
    const SE3 T_target_board(random_rotation(rng), random_vec3(rng, -0.3, 0.3));
    const SE3 T_cam_board = SE3(random_rotation(rng), Vec3::Zero()) *
                            random_board_pose(rng, rng.uniform(0.4, 1.0), rng.uniform(0.1, 1.0));
    std::vector<Vec3> points;
    for (const Vec3& p : on_plane(grid(5, 4, 0.04))) points.push_back(T_target_board * p);
    const SE3 T = T_cam_board * T_target_board.inverse();
    const auto poses = pose_planar(points, rays_to(T, points));
    ASSERT_TRUE(poses) << poses.error().text();
    errors.push_back(box_minus(poses->best.T_cam_board, T).norm());
    if (poses->other) ASSERT_LE(poses->best.rms_rad, poses->other->rms_rad);
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[9900], 1e-9);
  EXPECT_LT(errors.back(), 1e-6);
}

// From afar the other pose has the board's normal mirrored at the line of sight, up to the weak perspective.
TEST(PosePlanar, TheOtherMirrorsTheNormalAtTheLineOfSight) {
  Rng rng(2);
  const auto points = on_plane(grid(5, 4, 0.04));
  for (int i = 0; i < 300; ++i) {
    const SE3 T = random_board_pose(rng, 8, rng.uniform(0.4, 0.9));
    const auto poses = pose_planar(points, rays_to(T, points, &rng, 1e-6)).value();
    ASSERT_TRUE(poses.other);
    const Vec3 sight = T.t().normalized(), normal = T.R().col(2);
    const Vec3 mirrored = 2 * sight.dot(normal) * sight - normal;
    const Vec3 found = poses.other->T_cam_board.R().col(2);
    EXPECT_LT(std::acos(std::min(1.0, found.dot(mirrored))) * 180 / std::numbers::pi, 3) << "problem " << i;
  }
}

TEST(PosePlanar, BothAreMinimaOfTheirStatedError) {
  Rng rng(3);
  const auto points = on_plane(grid(6, 4, 0.04));
  int pairs = 0;
  for (int i = 0; i < 200; ++i) {
    const SE3 T = random_board_pose(rng, rng.uniform(1, 4), rng.uniform(0.2, 0.9));
    const auto rays = rays_to(T, points, &rng, 3e-4);
    const auto poses = pose_planar(points, rays).value();
    std::vector<PlanarPose> both{poses.best};
    if (poses.other) both.push_back(*poses.other);
    pairs += poses.other.has_value();
    for (const PlanarPose& pose : both) {
      const double here = cost(pose.T_cam_board, points, rays);
      EXPECT_NEAR(pose.rms_rad, std::sqrt(here / 24),
                  1e-6 * pose.rms_rad);  // chord against angle: 1/24 of its square
      // Steps of 1e-4 rad and of 1e-4 of the distance: far above rounding, far below the distance of the
      // minima.
      for (int k = 0; k < 6; ++k) {
        for (const double sign : {-1e-4, 1e-4}) {
          const Vec6 step = sign * (k < 3 ? 1.0 : T.t().norm()) * Vec6::Unit(k);
          EXPECT_GT(cost(box_plus(pose.T_cam_board, step), points, rays), here) << "problem " << i;
        }
      }
    }
  }
  EXPECT_GT(pairs, 150);
}

TEST(PosePlanar, FindsBothPosesOfOpenCV) {
  Rng rng(4);
  const auto points = on_plane(grid(5, 4, 0.04));
  const cv::Mat K = cv::Mat::eye(3, 3, CV_64F);
  for (int i = 0; i < 200; ++i) {
    const SE3 T = random_board_pose(rng, rng.uniform(2, 4), rng.uniform(0.4, 0.9));
    const auto rays = rays_to(T, points, &rng, 1e-5);
    std::vector<cv::Point3d> object;
    std::vector<cv::Point2d> image;
    for (std::size_t k = 0; k < points.size(); ++k) {
      object.emplace_back(points[k].x(), points[k].y(), points[k].z());
      image.emplace_back(rays[k].x() / rays[k].z(), rays[k].y() / rays[k].z());
    }
    std::vector<cv::Mat> r, t;
    cv::solvePnPGeneric(object, image, K, cv::noArray(), r, t, false, cv::SOLVEPNP_IPPE);
    ASSERT_EQ(r.size(), 2u);
    const auto poses = pose_planar(points, rays).value();
    ASSERT_TRUE(poses.other);
    const SE3* ours[] = {&poses.best.T_cam_board, &poses.other->T_cam_board};
    for (int k = 0; k < 2; ++k) {
      const SE3 theirs(so3_exp(Vec3(r[k].ptr<double>())), Vec3(t[k].ptr<double>()));
      // OpenCV's come from the derivative at one point, without a polish: the better one is within the noise
      // that this has, the other one also off by what the perspective adds.
      EXPECT_LT(rotation_angle(theirs.R().transpose() * ours[k]->R()), k == 0 ? 0.02 : 0.15)
          << "problem " << i;
      EXPECT_LE(cost(*ours[k], points, rays), cost(theirs, points, rays));
    }
  }
}

TEST(PosePlanar, RefusesWhatDoesNotDetermineAPose) {
  const SE3 T(so3_exp(Vec3(0.3, -0.2, 0.1)), Vec3(0, 0, 1));
  const auto message = [&](const std::vector<Vec3>& points, const SE3& pose) {
    const auto poses = pose_planar(points, rays_to(pose, points));
    EXPECT_FALSE(poses);
    if (poses) return std::string();
    EXPECT_EQ(poses.error().code, ErrorCode::kDegenerate);
    return poses.error().message;
  };
  EXPECT_THAT(message(on_plane({{0, 0}, {0.1, 0}, {0, 0.1}}), T), HasSubstr("3 points"));
  EXPECT_THAT(message(on_plane({{0, 0}, {0.1, 0}, {0.2, 0}, {0.3, 0}}), T), HasSubstr("on a line"));
  EXPECT_THAT(message(on_plane({{0, 0}, {0.1, 0}, {0.2, 0}, {0, 0.1}}), T), HasSubstr("all but one"));
  EXPECT_THAT(message(std::vector<Vec3>(5, Vec3(0.1, 0, 0)), T), HasSubstr("on a line"));
  EXPECT_THAT(message(box(0.2), T), HasSubstr("not in a plane"));
  EXPECT_THAT(
      message(on_plane(grid(4, 3, 0.05)), SE3(so3_exp(Vec3(std::numbers::pi / 2, 0, 0)), Vec3(0, 0, 1))),
      HasSubstr("edge-on"));
  std::vector<Vec3> broken = on_plane(grid(4, 3, 0.05));
  broken[0].x() = std::nan("");
  EXPECT_EQ(pose_planar(broken, rays_to(T, broken)).error().code, ErrorCode::kInvalidData);
}

}  // namespace
}  // namespace plumbline::test
