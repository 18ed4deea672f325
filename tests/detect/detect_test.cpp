// SPDX-License-Identifier: Apache-2.0
#include "plumbline/detect/detect.hpp"

#include <fmt/format.h>

#include <opencv2/core.hpp>

#include "detect/render.hpp"
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

// Neighbours foretell a corner at the rim of a bent board worse than elsewhere; it stays all the same.
TEST(DetectCharuco, FisheyeKeepsItsRim) {
  const Charuco board{8, 6, 0.03, 0.022, "4X4_50"};
  const Target target = *make_target(board);
  PlaneCamera camera = look_at(target, 15, -20, 12, 0.9);
  camera.size = {1000, 800};
  camera.centre = {499.5, 399.5};
  camera.is_fisheye = true;
  camera.f = 420;
  const Detection d = found(render(camera, charuco_shade(board, false)), target);
  const Accuracy a = accuracy(d, target, camera);
  report("charuco fisheye", a);
  EXPECT_EQ(a.found, 35) << d.reason;
  EXPECT_LT(a.worst, 0.1);
}

// The same markers on a board with another number of columns: a row of them fits, the others do not.
TEST(DetectCharuco, AnotherBoardOfTheSameMarkers) {
  const Charuco shown{7, 6, 0.03, 0.022, "4X4_50"};
  const cv::Mat image = render(look_at(*make_target(shown), 10, -5, 8), charuco_shade(shown, false));
  const Detection d = found(image, *make_target(Charuco{9, 8, 0.03, 0.022, "4X4_50"}));
  EXPECT_TRUE(d.corners.empty());
  EXPECT_THAT(d.reason, testing::HasSubstr("another one"));
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
  EXPECT_LT(a.worst,
            1.5);  // at the steep edge the squares between tags are 3 px wide, less than the smallest window
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

// The true half-turn symmetry of each pattern decides whether its numbering is unique.
TEST(DetectNumbering, UniqueBoardsKeepTheirFirstCornerUpsideDown) {
  const Target chess = *make_target(Chessboard{9, 6, 0.025}),
               circles = *make_target(Circles{4, 11, 0.02, 0, true});
  for (const double roll : {0.0, 90.0, 180.0, 270.0}) {
    const PlaneCamera a = look_at(chess, 10, 5, roll, 2.2), b = look_at(circles, 10, 5, roll, 2.2);
    EXPECT_LT(accuracy(found(render(a, chessboard_shade({9, 6, 0.025})), chess), chess, a).worst, 0.2)
        << roll;
    EXPECT_LT(
        accuracy(found(render(b, circles_shade({4, 11, 0.02, 0, true}, 0.016)), circles), circles, b).worst,
        0.2)
        << roll;
  }
}

TEST(DetectNumbering, SymmetricBoardsBeginAtTheTopLeft) {
  for (const Chessboard& board :
       {Chessboard{8, 6, 0.025}, Chessboard{7, 7, 0.025}, Chessboard{6, 6, 0.025}}) {
    const Target target = *make_target(board);
    for (const double roll : {0.0, 180.0}) {
      const PlaneCamera camera = look_at(target, 10, 5, roll + 8, 2.0);
      const Detection d = found(render(camera, chessboard_shade(board)), target);
      ASSERT_EQ(d.corners.size(), target.points.size());
      const Vec2 first = d.corners.front().px, right = d.corners[1].px, below = d.corners[board.columns].px;
      EXPECT_GT(right.x(), first.x() + 5);
      EXPECT_GT(below.y(), first.y() + 5);
      const std::size_t expected = roll == 0 ? 0 : target.points.size() - 1;
      EXPECT_LT((first - camera.px_of(target.points[expected])).norm(), 0.2);
    }
  }
}

// sigma is what the errors are: on rendered boards within a factor of two, from clean to very noisy.
TEST(DetectSigma, IsTheErrorOnRenderedBoards) {
  const Target chess = *make_target(Chessboard{9, 6, 0.025}),
               april = *make_target(AprilGrid{6, 4, 0.088, 0.3});
  const Target circles = *make_target(Circles{9, 7, 0.02});
  for (const double noise : {0.0, 3.0, 10.0}) {
    for (const double distance : {1.6, 3.0}) {
      Render how;
      how.noise = noise;
      how.samples = noise > 0 ? 5 : 9;  // a disc's outline drawn with 5 x 5 points is worse than its measure
      const auto ratio = [&](const Target& target, const Shade& shade) {
        const PlaneCamera camera = look_at(target, 20, 10, 15, distance);
        const Accuracy a = accuracy(found(render(camera, shade, how), target), target, camera);
        report("sigma", a);
        return a.rms_axis / a.mean_sigma;
      };
      for (const double r :
           {ratio(chess, chessboard_shade({9, 6, 0.025})), ratio(april, aprilgrid_shade({6, 4, 0.088, 0.3})),
            ratio(circles, circles_shade({9, 7, 0.02}, 0.01))}) {
        EXPECT_GT(r, 0.5) << noise << " " << distance;
        EXPECT_LT(r, 2.0) << noise << " " << distance;
      }
    }
  }
}

TEST(DetectRig, PartsAreToldApartByTheirIds) {
  const Charuco a{5, 4, 0.03, 0.022, "4X4_50", 0}, b{5, 4, 0.03, 0.022, "4X4_50", 10};
  const SE3 shift(Mat3::Identity(), Vec3(0.2, 0, 0));
  const auto target = make_target(BoardRig{{{a, SE3()}, {b, shift}}});
  ASSERT_TRUE(target) << target.error().text();
  const PlaneCamera camera = look_at(*target, 15, 10, 5, 1.6);
  const Shade first = charuco_shade(a, false), second = charuco_shade(b, false);
  const Shade both = [&](const Vec2& p) { return p.x() < 0.145 ? first(p) : second(p - Vec2(0.2, 0)); };
  const Accuracy whole = accuracy(found(render(camera, both), *target), *target, camera);
  EXPECT_EQ(whole.found, 24);
  EXPECT_LT(whole.worst, 0.2);
  const Shade only_second = [&](const Vec2& p) { return p.x() < 0.145 ? -1 : second(p - Vec2(0.2, 0)); };
  const Detection d = found(render(camera, only_second), *target);
  ASSERT_EQ(d.corners.size(), 12U);
  EXPECT_EQ(d.corners.front().point, 12);
}

TEST(DetectReason, EmptyImagesSayWhy) {
  const cv::Mat flat(240, 320, CV_8U, cv::Scalar(128));
  cv::Mat noise(240, 320, CV_8U);
  cv::RNG(3).fill(noise, cv::RNG::UNIFORM, 0, 255);
  const TargetSpec specs[] = {Chessboard{}, Charuco{}, AprilGrid{}, Circles{}, Circles{4, 11, 0.02, 0, true}};
  for (const TargetSpec& spec : specs) {
    const Target target = *make_target(spec);
    for (const cv::Mat& image : {flat, noise, cv::Mat(flat(cv::Rect(0, 0, 9, 9)))}) {
      const Detection d = found(image, target);
      EXPECT_TRUE(d.corners.empty());
      EXPECT_TRUE(d.method.empty());
      EXPECT_THAT(d.reason, testing::ContainsRegex("[0-9]")) << target.name;
    }
  }
}

TEST(DetectReason, FewTagsAreCounted) {
  const Target target = *make_target(AprilGrid{6, 4, 0.088, 0.3});
  const PlaneCamera camera = look_at(target, 5, 5, 5, 1.6);
  cv::Mat image = render(camera, aprilgrid_shade({6, 4, 0.088, 0.3}));
  const Vec2 cut = camera.px_of(Vec3(0.09, 0.088 * 1.3 * 3 + 0.05, 0));  // tags 0, 6 and 12 stay
  image.colRange(static_cast<int>(cut.x()) + 8, image.cols).setTo(130);
  image.rowRange(0, static_cast<int>(cut.y())).setTo(130);
  const Detection d = found(image, target);
  EXPECT_EQ(d.reason, "3 of 24 tags found, at least 4 are needed");
}

TEST(DetectTarget, FreePointsAreUnsupported) {
  const Target target = *make_target(Points3d{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}});
  const auto result = detect_target(cv::Mat(100, 100, CV_8U, cv::Scalar(0)), target);
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::kUnsupported);
}

}  // namespace
}  // namespace plumbline::test
