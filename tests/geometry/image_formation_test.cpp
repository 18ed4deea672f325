// SPDX-License-Identifier: Apache-2.0
#include "plumbline/geometry/image_formation.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <vector>

#include "plumbline/core/random.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline {
namespace {

struct Camera {
  Mat3 K;
  SE3 T_cam_world;
};

Camera random_camera(Rng& rng) {
  Camera c;
  c.K << rng.uniform(300, 2000), rng.uniform(-5, 5), rng.uniform(200, 800), 0, rng.uniform(300, 2000),
      rng.uniform(200, 800), 0, 0, 1;
  const double x = rng.normal(), y = rng.normal(), z = rng.normal();
  c.T_cam_world = {so3_exp(Vec3(x, y, z)), Vec3(rng.normal(), rng.normal(), rng.normal())};
  return c;
}

Vec3 random_point(Rng& rng) {
  const double x = rng.normal(3), y = rng.normal(3);
  return {x, y, rng.normal(3)};
}

TEST(ImageFormation, AgreesWithKTimesThePointInTheCameraAndItsDepth) {
  Rng rng(1);
  for (int i = 0; i < 1000; ++i) {
    const Camera c = random_camera(rng);
    const Mat34 P = compose_camera_matrix(c.K, c.T_cam_world);
    const Vec3 p_world = random_point(rng), p_cam = c.T_cam_world.R() * p_world + c.T_cam_world.t();
    for (double scale : {1.0, -1.0, 1e-5, -300.0}) {
      const auto image = image_of(scale * P, p_world);
      ASSERT_TRUE(image);
      // Near the principal plane the pixel is as large as 1 / z.
      const double tolerance = 1e-12 * (1 + c.K.norm() * p_cam.norm() / std::abs(p_cam.z()));
      EXPECT_LT((image->px - (c.K * p_cam).hnormalized()).norm(),
                tolerance / std::min(1.0, std::abs(p_cam.z())));
      EXPECT_NEAR(image->depth, p_cam.z(), 1e-13 * (1 + p_cam.norm() + c.T_cam_world.t().norm()));
      for (double w : {1.0, -2.0, 1e3}) {
        EXPECT_NEAR(signed_depth(scale * P, w * p_world.homogeneous()), p_cam.z(),
                    1e-13 * (1 + p_cam.norm() + c.T_cam_world.t().norm()));
      }
    }
  }
}

TEST(ImageFormation, AgreesWithOpenCv) {
  Rng rng(2);
  for (int i = 0; i < 50; ++i) {
    Camera c = random_camera(rng);
    c.K(0, 1) = 0;  // OpenCV has no skew
    const Vec3 w = so3_log(c.T_cam_world.R()), t = c.T_cam_world.t(), p = random_point(rng);
    if ((c.T_cam_world * p).z() < 0.1) continue;
    std::vector<cv::Point2d> px;
    const cv::Matx33d K(c.K(0, 0), 0, c.K(0, 2), 0, c.K(1, 1), c.K(1, 2), 0, 0, 1);
    cv::projectPoints(std::vector<cv::Point3d>{{p.x(), p.y(), p.z()}}, cv::Vec3d(w.x(), w.y(), w.z()),
                      cv::Vec3d(t.x(), t.y(), t.z()), K, cv::noArray(), px);
    const auto image = image_of(compose_camera_matrix(c.K, c.T_cam_world), p);
    EXPECT_LT((image->px - Vec2(px[0].x, px[0].y)).norm(), 1e-11 * (1 + image->px.norm()));
  }
}

TEST(ImageFormation, ThePrincipalPlaneHasNoImage) {
  Rng rng(3);
  for (int i = 0; i < 200; ++i) {
    const Camera c = random_camera(rng);
    const Mat34 P = compose_camera_matrix(c.K, c.T_cam_world);
    const Vec3 p_world = c.T_cam_world.inverse() * Vec3(rng.normal(), rng.normal(), 0);
    // Rounding of the point itself may leave a depth of some 1e-16; either there is no image or it is that
    // far out.
    if (const auto image = image_of(P, p_world)) EXPECT_LT(std::abs(image->depth), 1e-14);
    EXPECT_NEAR(signed_depth(P, p_world.homogeneous()), 0, 1e-14);
    // The camera's centre has neither image nor depth.
    if (const auto image = image_of(P, c.T_cam_world.centre())) EXPECT_LT(std::abs(image->depth), 1e-14);
  }
  const Mat34 P = compose_camera_matrix(Vec3(500, 500, 1).asDiagonal(), SE3());
  EXPECT_FALSE(image_of(P, Vec3(1, 2, 0)));
  EXPECT_FALSE(image_of(P, Vec3::Zero()));
  EXPECT_LT(image_of(P, Vec3(0, 0, -2))->depth, 0);
}

TEST(ImageFormation, PointsAtInfinityHaveASide) {
  const Mat34 P = compose_camera_matrix(Vec3(500, 500, 1).asDiagonal(), SE3());
  EXPECT_EQ(signed_depth(P, Vec4(0.1, 0, 1, 0)), std::numeric_limits<double>::infinity());
  EXPECT_EQ(signed_depth(-P, Vec4(0.1, 0, -1, 0)), -std::numeric_limits<double>::infinity());
}

TEST(ImageFormation, ACameraAtInfinityIsACallersBug) {
  Mat34 affine;
  affine << 500, 0, 0, 320, 0, 500, 0, 240, 0, 0, 0, 1;
  EXPECT_THROW((void)image_of(affine, Vec3(0, 0, 1)), std::invalid_argument);
  EXPECT_THROW((void)signed_depth(affine, Vec4(0, 0, 1, 1)), std::invalid_argument);
}

}  // namespace
}  // namespace plumbline
