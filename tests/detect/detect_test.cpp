// SPDX-License-Identifier: Apache-2.0
#include "plumbline/detect/detect.hpp"

#include <fmt/format.h>

#include "detect/render.hpp"
#include "plumbline/core/random.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

Detection found(const cv::Mat& image, const Target& target) {
  const auto result = detect_target(image, target);
  EXPECT_TRUE(result) << result.error().text();
  if (!result) return {};
  EXPECT_EQ(result->corners.empty(), !result->reason.empty());
  return *result;
}

void report(const char* what, const Accuracy& a) {
  if (std::getenv("PLUMBLINE_VERBOSE") != nullptr)
    fmt::print("{}: {} found, mean {:.4f}, rms/axis {:.4f}, sigma {:.4f}, worst {:.3f}, bias {:.4f} {:.4f}\n",
               what, a.found, a.mean_error, a.rms_axis, a.mean_sigma, a.worst, a.bias.x(), a.bias.y());
}

struct Pose {
  double pitch, yaw, roll;
};
constexpr Pose kPoses[] = {{0, 0, 3}, {30, 0, 10}, {-10, 35, -25}, {20, -30, 40}};

TEST(DetectChessboard, AllCornersInPlace) {
  const Target target = *make_target(Chessboard{9, 6, 0.025});
  for (const Pose& pose : kPoses) {
    const PlaneCamera camera = look_at(target, pose.pitch, pose.yaw, pose.roll);
    const Accuracy a =
        accuracy(found(render(camera, chessboard_shade({9, 6, 0.025})), target), target, camera);
    report("chessboard", a);
    EXPECT_EQ(a.found, 54);
    EXPECT_LT(a.mean_error, 0.03);
    EXPECT_LT(a.worst, 0.1);
    EXPECT_LT(a.bias.cwiseAbs().maxCoeff(), 0.01);
  }
}

TEST(DetectChessboard, Fisheye) {
  const Target target = *make_target(Chessboard{9, 6, 0.025});
  PlaneCamera camera = look_at(target, 15, -20, 12, 0.55);
  camera.is_fisheye = true;
  camera.f = 210;
  const Accuracy a = accuracy(found(render(camera, chessboard_shade({9, 6, 0.025})), target), target, camera);
  report("chessboard fisheye", a);
  EXPECT_EQ(a.found, 54);
  EXPECT_LT(a.mean_error, 0.05);
  EXPECT_LT(a.bias.cwiseAbs().maxCoeff(), 0.02);
}

TEST(DetectCharuco, BothLayouts) {
  for (const auto& [rows, legacy] : {std::pair{6, false}, {6, true}, {5, false}}) {
    const Charuco board{8, rows, 0.03, 0.022, "4X4_50", 3};
    const Target target = *make_target(board);
    for (const Pose& pose : kPoses) {
      const PlaneCamera camera = look_at(target, pose.pitch, pose.yaw, pose.roll);
      const Detection d = found(render(camera, charuco_shade(board, legacy)), target);
      const Accuracy a = accuracy(d, target, camera);
      report(d.method.c_str(), a);
      EXPECT_EQ(a.found, static_cast<int>(target.points.size()));
      EXPECT_LT(a.mean_error, 0.05);
      EXPECT_LT(a.bias.cwiseAbs().maxCoeff(), 0.02);  // windows of 2 to 4 px: aliasing is the larger part
      EXPECT_EQ(d.method.find("legacy") != std::string::npos, legacy);
    }
  }
}

TEST(DetectCharuco, Negative) {
  const Charuco board{4, 5, 0.054, 0.0405, "4X4_50"};
  const Target target = *make_target(board);
  const PlaneCamera camera = look_at(target, 20, 10, -15, 2.0);
  const Accuracy a =
      accuracy(found(render(camera, charuco_shade(board, false, true)), target), target, camera);
  report("charuco negative", a);
  EXPECT_EQ(a.found, 12);
  EXPECT_LT(a.mean_error, 0.05);
}

TEST(DetectAprilGrid, AllCornersInPlace) {
  const AprilGrid board{6, 4, 0.088, 0.3, "36h11", 7};
  const Target target = *make_target(board);
  for (const Pose& pose : kPoses) {
    const PlaneCamera camera = look_at(target, pose.pitch, pose.yaw, pose.roll);
    const Accuracy a = accuracy(found(render(camera, aprilgrid_shade(board)), target), target, camera);
    report("aprilgrid", a);
    EXPECT_EQ(a.found, 96);
    EXPECT_LT(a.mean_error, 0.06);
    EXPECT_LT(a.bias.cwiseAbs().maxCoeff(), 0.01);
  }
}

TEST(DetectAprilGrid, Fisheye) {
  const AprilGrid board{6, 6, 0.088, 0.3};
  const Target target = *make_target(board);
  PlaneCamera camera = look_at(target, 15, -20, 12, 0.6);
  camera.size = {800, 700};
  camera.centre = {399.5, 349.5};
  camera.is_fisheye = true;
  camera.f = 300;
  const Accuracy a = accuracy(found(render(camera, aprilgrid_shade(board)), target), target, camera);
  report("aprilgrid fisheye", a);
  EXPECT_GT(a.found, 140);
  EXPECT_LT(a.mean_error, 0.05);
  EXPECT_LT(a.worst, 0.5);
  EXPECT_LT(a.bias.cwiseAbs().maxCoeff(), 0.02);
}

TEST(DetectCircles, SymmetricAndAsymmetric) {
  for (const Circles& board : {Circles{9, 7, 0.02, 0, false}, Circles{4, 11, 0.02, 0, true}}) {
    const Target target = *make_target(board);
    for (const Pose& pose : kPoses) {
      const PlaneCamera camera = look_at(target, pose.pitch, pose.yaw, pose.roll);
      const Accuracy a =
          accuracy(found(render(camera, circles_shade(board, board.asymmetric ? 0.016 : 0.01)), target),
                   target, camera);
      report("circles", a);
      EXPECT_EQ(a.found, static_cast<int>(target.points.size()));
      EXPECT_LT(a.mean_error, 0.03);
      EXPECT_LT(a.bias.cwiseAbs().maxCoeff(), 0.01);
    }
  }
}

}  // namespace
}  // namespace plumbline::test
