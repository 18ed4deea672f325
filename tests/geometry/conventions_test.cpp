// SPDX-License-Identifier: Apache-2.0
// One test for each statement of docs/conventions.md, in its order; the names are those of its headings.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "plumbline/core/random.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/rig/calibration.hpp"
#include "plumbline/target/target.hpp"

namespace plumbline {
namespace {

constexpr double kQuarter = std::numbers::pi / 2;

// A grey disc drawn symmetrically around the sample (column 20, row 10): whose centroid, with pixels counted
// from the centre of the top-left one, is (20, 10).
TEST(Conventions, PixelZeroIsACentre) {
  cv::Mat image(32, 48, CV_8U, cv::Scalar(0));
  for (int dy = -2; dy <= 2; ++dy) {
    for (int dx = -2; dx <= 2; ++dx)
      image.at<uchar>(10 + dy, 20 + dx) = static_cast<uchar>(100 - 10 * (dx * dx + dy * dy));
  }
  const cv::Moments m = cv::moments(image);
  EXPECT_DOUBLE_EQ(m.m10 / m.m00, 20.0);  // OpenCV's convention is ours
  EXPECT_DOUBLE_EQ(m.m01 / m.m00, 10.0);
  // The middle of a 48x32 image is between samples 23 and 24, and 15 and 16.
  const auto lens = make_lens("pinhole", ImageSize{48, 32}, 100.0);
  ASSERT_TRUE(lens);
  EXPECT_EQ(*project(*lens, Vec3(0, 0, 1)), Vec2(23.5, 15.5));
}

TEST(Conventions, XRightYDownZForward) {
  for (std::string_view name : lens_names()) {
    const Lens lens = *make_lens(name, ImageSize{640, 480}, 500.0);
    const Vec2 centre = project(lens, Vec3(0, 0, 1)).value();
    EXPECT_GT(project(lens, Vec3(0.1, 0, 1))->x(), centre.x()) << name;  // right is a larger column
    EXPECT_GT(project(lens, Vec3(0, 0.1, 1))->y(), centre.y()) << name;  // down is a larger row
    EXPECT_FALSE(is_central_perspective(lens) && project(lens, Vec3(0, 0, -1))) << name;
  }
  EXPECT_EQ(Vec3::UnitX().cross(Vec3::UnitY()), Vec3(Vec3::UnitZ()));
}

TEST(Conventions, MetresRadiansPixels) {
  const auto target = make_target(Chessboard{9, 6, 0.025});
  ASSERT_TRUE(target);
  EXPECT_DOUBLE_EQ((target->points[1] - target->points[0]).norm(), 0.025);
  EXPECT_LT((so3_exp(Vec3(0, 0, kQuarter)) * Vec3::UnitX() - Vec3::UnitY()).norm(), 1e-15);
  EXPECT_DOUBLE_EQ(project(*make_lens("pinhole", ImageSize{1, 1}, 500), Vec3(0.002, 0, 1))->x(), 1.0);
}

TEST(Conventions, TransformsAreNamedToFrom) {
  // The board's origin lies 2 m in front of the camera: T_cam_board takes it there.
  const SE3 T_cam_board(Mat3::Identity(), Vec3(0, 0, 2)),
      T_board_part(so3_exp(Vec3(0, 0, kQuarter)), Vec3(1, 0, 0));
  const Vec3 p_part(1, 0, 0);
  EXPECT_LT((T_cam_board * Vec3::Zero() - Vec3(0, 0, 2)).norm(), 1e-15);
  EXPECT_LT((T_board_part * p_part - Vec3(1, 1, 0)).norm(), 1e-15);  // rotation first, then translation
  const SE3 T_cam_part = T_cam_board * T_board_part;                 // adjacent names cancel
  EXPECT_LT((T_cam_part * p_part - Vec3(1, 1, 2)).norm(), 1e-15);
  EXPECT_LT((T_cam_board.inverse() * Vec3(0, 0, 2)).norm(), 1e-15);
}

TEST(Conventions, CameraCentreIsMinusRTransposedT) {
  // A camera 3 m to the right of the world's origin that looks along the world's x axis.
  Mat3 R_cam_world;
  R_cam_world << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  const Vec3 centre_world(3, 0, 0);
  const SE3 T_cam_world(R_cam_world, -R_cam_world * centre_world);
  EXPECT_LT((T_cam_world.centre() - centre_world).norm(), 1e-15);
  EXPECT_LT((T_cam_world * Vec3(5, 0, 0) - Vec3(0, 0, 2)).norm(), 1e-15);
}

TEST(Conventions, QuaternionIsWxyzHamiltonWithPositiveW) {
  const double s = std::sqrt(0.5);
  const SE3 T(so3_exp(Vec3(0, 0, kQuarter)), Vec3(4, 5, 6));
  const std::array<double, 7> expected{s, 0, 0, s, 4, 5, 6};  // qw qx qy qz tx ty tz
  for (int i = 0; i < 7; ++i) EXPECT_NEAR(T.qt[i], expected[i], 1e-15) << i;
  EXPECT_GE(SE3(so3_exp(Vec3(0, 0, 3.5)), Vec3::Zero()).qt[0],
            0);  // beyond half a turn: q and -q are one rotation
}

TEST(Conventions, RotationVectorsAreThoseOfOpenCv) {
  Rng rng(1);
  for (double angle : {0.0, 1e-9, 1e-3, 0.5, 2.0, 3.1, std::numbers::pi - 1e-6}) {
    for (int i = 0; i < 20; ++i) {
      const Vec3 w = angle * Vec3(rng.normal(), rng.normal(), rng.normal()).normalized();
      cv::Mat R_cv, w_cv;
      cv::Rodrigues(cv::Vec3d(w.x(), w.y(), w.z()), R_cv);
      const Mat3 R = so3_exp(w);
      cv::Matx33d R_ours;
      for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) {
          EXPECT_NEAR(R(r, c), R_cv.at<double>(r, c), 1e-15) << angle;
          R_ours(r, c) = R(r, c);
        }
      }
      cv::Rodrigues(R_ours, w_cv);
      const Vec3 back = so3_log(R);
      // Within 1e-5 of pi OpenCV 4.6 takes both signs of the axis for the same; ours keeps the right one.
      if (angle > 3.14) {
        EXPECT_LT((back - w).norm(), 1e-14);
        continue;
      }
      // OpenCV takes the angle from an arc cosine, which loses digits where the cosine is near 1 or -1.
      const double tolerance = angle < 1e-2 ? 2e-8 : angle > 3 ? 1e-13 : 1e-14;
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(back[k], w_cv.at<double>(k), tolerance) << angle;
    }
  }
}

TEST(Conventions, StepsAreOnTheLeftRotationBeforeTranslation) {
  const SE3 T(so3_exp(Vec3(0.4, 0, 0)), Vec3(1, 2, 3));
  Vec6 d;
  d << 0, 0, kQuarter, 0.1, 0, 0;
  const SE3 moved = box_plus(T, d);
  EXPECT_LT((moved.R() - so3_exp(Vec3(0, 0, kQuarter)) * T.R()).norm(), 1e-15);
  EXPECT_LT((moved.t() - Vec3(1.1, 2, 3)).norm(), 1e-15);
  EXPECT_LT((se3_exp(d).t() - Vec3(0.1, 0, 0)).norm(),
            0.1);  // exp turns the translation too, box_plus does not
  EXPECT_GT((se3_exp(d).t() - Vec3(0.1, 0, 0)).norm(), 0.01);
}

TEST(Conventions, RigPosesLeadFromTheRigToACamera) {
  // A second camera 0.1 m to the right of the first sees a point further to the left.
  Calibration c;
  c.data.targets = {*make_target(Chessboard{3, 3, 0.1})};
  for (const char* name : {"left", "right"})
    c.rig.cameras.push_back({name, {640, 480}, *make_lens("pinhole", {640, 480}, 500.0)});
  c.rig.T_cam_rig = {SE3(), SE3(Mat3::Identity(), Vec3(-0.1, 0, 0))};
  c.T_rig_board = {SE3(Mat3::Identity(), Vec3(0, 0, 1))};
  View left, right;
  right.cam = 1;
  EXPECT_LT((*predict(c, left, 0) - Vec2(319.5, 239.5)).norm(), 1e-12);
  EXPECT_LT((*predict(c, right, 0) - Vec2(319.5 - 50, 239.5)).norm(), 1e-12);  // disparity f b / Z = 50 px
  EXPECT_LT((c.rig.T_cam_rig[1].centre() - Vec3(0.1, 0, 0)).norm(), 1e-15);
}

TEST(Conventions, BoardPosesLeadFromABoardToTheFirst) {
  // A second board 0.2 m to the right of the first, in the first one's frame.
  Calibration c;
  c.data.targets = {*make_target(Chessboard{3, 3, 0.1}), *make_target(Chessboard{4, 3, 0.1})};
  c.rig.cameras.push_back({"cam", {640, 480}, *make_lens("pinhole", {640, 480}, 500.0)});
  c.rig.T_cam_rig = {SE3()};
  c.T_rig_board = {SE3(Mat3::Identity(), Vec3(0, 0, 1))};
  c.T_board0_board = {SE3(), SE3(Mat3::Identity(), Vec3(0.2, 0, 0))};
  View first, second;
  second.target = 1;
  EXPECT_LT((*predict(c, first, 0) - Vec2(319.5, 239.5)).norm(), 1e-12);
  EXPECT_LT((*predict(c, second, 0) - Vec2(319.5 + 100, 239.5)).norm(), 1e-12);  // f 0.2 / Z = 100 px
}

TEST(Conventions, BoardsAreNumberedRowByRowFromTheTopLeft) {
  const auto chessboard = make_target(Chessboard{9, 6, 0.025});
  ASSERT_TRUE(chessboard);
  EXPECT_EQ(chessboard->points[0], Vec3(0, 0, 0));
  EXPECT_LT((chessboard->points[8] - Vec3(0.2, 0, 0)).norm(), 1e-15);    // the end of the first row
  EXPECT_LT((chessboard->points[9] - Vec3(0, 0.025, 0)).norm(), 1e-15);  // y DOWN: the second row
  const auto circles = make_target(Circles{4, 11, 0.02, 0, true});
  ASSERT_TRUE(circles);
  EXPECT_LT((circles->points[1] - Vec3(0.04, 0, 0)).norm(), 1e-15);
  EXPECT_LT((circles->points[4] - Vec3(0.02, 0.02, 0)).norm(), 1e-15);
  // A board held upright in front of the camera, its rows to the right: it is seen with the same turn.
  const SE3 T_cam_board(Mat3::Identity(), Vec3(0, 0, 1));
  const Lens lens = *make_lens("pinhole", {640, 480}, 500.0);
  EXPECT_GT(project(lens, T_cam_board * chessboard->points[9])->y(),
            project(lens, T_cam_board * chessboard->points[0])->y());
}

TEST(Conventions, AprilGridsAreNumberedFromTheBottomLeft) {
  const auto grid = make_target(AprilGrid{6, 6, 0.1, 0.3, "36h11", 0});
  ASSERT_TRUE(grid);
  EXPECT_EQ(grid->points[0], Vec3(0, 0, 0));
  EXPECT_LT((grid->points[1] - Vec3(0.1, 0, 0)).norm(), 1e-15);
  EXPECT_LT((grid->points[2] - Vec3(0.1, 0.1, 0)).norm(), 1e-15);  // y UP: counter-clockwise as it is read
  EXPECT_LT((grid->points[3] - Vec3(0, 0.1, 0)).norm(), 1e-15);
  EXPECT_LT((grid->points[4] - Vec3(0.13, 0, 0)).norm(), 1e-15);   // the next tag: tag_m (1 + spacing)
  EXPECT_LT((grid->points[24] - Vec3(0, 0.13, 0)).norm(), 1e-15);  // the row above
}

TEST(Conventions, BowsLiftTheMiddleAlongZ) {
  Calibration c;
  c.data.targets = {*make_target(Chessboard{5, 3, 0.025})};
  c.bow_m = {Vec2(0.003, 0.001)};
  EXPECT_LT((board_point(c, 0, 0) - Vec3(0, 0, 0)).norm(), 1e-15);                 // a corner
  EXPECT_LT((board_point(c, 0, 7) - Vec3(0.05, 0.025, 0.004)).norm(), 1e-15);      // the middle
  EXPECT_LT((board_point(c, 0, 2) - Vec3(0.05, 0, 0.003)).norm(), 1e-15);          // of the upper edge
  EXPECT_LT((board_point(c, 0, 1) - Vec3(0.025, 0, 0.75 * 0.003)).norm(), 1e-15);  // 1 - (1/2)^2
}

// A board that moves to the right by 1 m/s, 1 m away, before a lens of 100 px: 100 px/s.
TEST(Conventions, TimesAreOfTheMiddleRow) {
  Calibration c;
  const ImageSize size{640, 481};
  c.rig = {{{"cam", size, *make_lens("pinhole", size, 100.0)}}, {SE3()}};
  c.data.cameras = {{"cam", size}};
  c.data.targets = {*make_target(Chessboard{3, 3, 0.5})};
  for (int f = 0; f < 5; ++f) {
    c.data.frames.push_back(std::to_string(f));
    c.T_rig_board.emplace_back(SE3(Mat3::Identity(), Vec3(0.1 * f, 0, 1)));
    View view{0, f, "", {{0, Vec2(0, 0), 1}}, ""};
    view.time_s = 0.1 * f;
    c.data.views.push_back(view);
  }
  const double still = predict(c, c.data.views[2], 3)->x();  // point 3 is half a metre below: row 290
  c.clocks = {{1e-4, std::nullopt}};
  EXPECT_NEAR(predict(c, c.data.views[2], 3)->x() - still, 100 * 1e-4 * 50, 1e-9);
  c.clocks = {{std::nullopt, 0.01}};
  EXPECT_NEAR(predict(c, c.data.views[2], 3)->x() - still, 100 * 0.01, 1e-9);
}

TEST(Conventions, RmsIsPerCornerAsInOpenCv) {
  Calibration c;
  c.data.views.resize(1);
  c.fits = {{CornerFit{Vec2(3, 4), false}, CornerFit{Vec2(0, 0), false}, CornerFit{Vec2(100, 0), true}}};
  EXPECT_DOUBLE_EQ(view_rms_px(c, 0),
                   std::sqrt(25.0 / 2));  // both coordinates of a corner count as one; no outliers
}

}  // namespace
}  // namespace plumbline
