// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rig/calibration.hpp"

#include <opencv2/calib3d.hpp>

#include "plumbline/geometry/so3.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {

Calibration two_cameras() {
  Calibration c;
  c.rig.cameras = {{"left", {640, 480}, OpenCV5{500, 505, 320, 240, {-0.2, 0.05, 0.001, 0.002, 0.01}}},
                   {"right", {640, 480}, Pinhole{510, 510, 318, 238}}};
  c.rig.T_cam_rig = {SE3(), SE3(so3_exp({0.01, -0.05, 0.02}), {-0.1, 0.002, 0.003})};
  c.data.targets = {*make_target(Chessboard{})};
  c.data.cameras = {{"left", {640, 480}}, {"right", {640, 480}}};
  c.data.frames = {"0", "1"};
  c.T_rig_board = {SE3(so3_exp({0.2, 0.3, 0.1}), {-0.1, -0.05, 0.6}), std::nullopt};
  return c;
}

TEST(Calibration, PredictIsOpenCVsProjectionOfTheChain) {
  const Calibration c = two_cameras();
  for (int cam : {0, 1}) {
    const SE3 T_cam_board = c.rig.T_cam_rig[cam] * *c.T_rig_board[0];
    const Vec3 w = so3_log(T_cam_board.R()), t = T_cam_board.t();
    const Vec3& p = c.data.targets[0].points[30];
    const auto k = params(c.rig.cameras[cam].lens);
    const cv::Mat K = (cv::Mat_<double>(3, 3) << k[0], 0, k[2], 0, k[1], k[3], 0, 0, 1);
    std::vector<cv::Point2d> px;
    cv::projectPoints(std::vector<cv::Point3d>{{p.x(), p.y(), p.z()}}, cv::Vec3d(w.x(), w.y(), w.z()),
                      cv::Vec3d(t.x(), t.y(), t.z()), K, std::vector<double>(k.begin() + 4, k.end()), px);
    View view;
    view.cam = cam;
    const auto ours = predict(c, view, 30);
    ASSERT_TRUE(ours);
    EXPECT_NEAR(ours->x(), px[0].x, 1e-9);
    EXPECT_NEAR(ours->y(), px[0].y, 1e-9);
  }
  View without_pose;
  without_pose.frame = 1;
  EXPECT_FALSE(predict(c, without_pose, 0));
}

TEST(Calibration, AFurtherBoardStandsWhereTheFirstOnePutsIt) {
  Calibration c = two_cameras();
  c.data.targets.push_back(*make_target(Charuco{}));
  c.T_board0_board.push_back(SE3(so3_exp({0.4, -0.2, 1.3}), {0.3, -0.1, 0.05}));
  // The same point given in the first board's frame is the same pixel.
  const Vec3 p = c.data.targets[1].points[17];
  const View first{.cam = 1}, second{.cam = 1, .target = 1};
  c.data.targets[0].points[30] = c.T_board0_board[1].R() * p + c.T_board0_board[1].t();
  EXPECT_LT((*predict(c, second, 17) - *predict(c, first, 30)).norm(), 1e-10);
  EXPECT_LT((*board_pose(c, second) * p - *board_pose(c, first) * c.data.targets[0].points[30]).norm(),
            1e-14);
  EXPECT_EQ(*board_pose(c, first), *c.T_rig_board[0]);
  EXPECT_FALSE(board_pose(c, View{.frame = 1, .target = 1}));
  const auto names = shared_parameter_names(c);
  ASSERT_EQ(names.size(), 9U + 4U + 6U + 6U);
  EXPECT_EQ(names[18], "right t_z");
  EXPECT_EQ(names[19], c.data.targets[1].name + " r_x");
  EXPECT_EQ(names.back(), c.data.targets[1].name + " t_z");
}

TEST(Calibration, HashesTellBoardsApart) {
  Calibration c = two_cameras();
  c.data.targets.push_back(*make_target(Charuco{}));
  c.data.views = {{0, 0, "a", {{0, {1, 1}}}, ""}};
  const std::string first = corners_hash(c.data);
  c.data.views[0].target = 1;
  EXPECT_NE(corners_hash(c.data), first);
}

TEST(Calibration, SharedParametersAreNamedInOrder) {
  const auto names = shared_parameter_names(two_cameras().rig);
  ASSERT_EQ(names.size(), 9U + 4U + 6U);
  EXPECT_EQ(names[0], "left fx");
  EXPECT_EQ(names[8], "left k3");
  EXPECT_EQ(names[9], "right fx");
  EXPECT_EQ(names[13], "right r_x");
  EXPECT_EQ(names[18], "right t_z");
}

TEST(Calibration, RmsCountsInliersOnly) {
  Calibration c = two_cameras();
  c.data.views = {{0, 0, "a", {{0, {1, 1}}, {1, {2, 2}}}, ""}, {1, 0, "b", {{0, {1, 1}}}, ""}};
  c.fits = {{{{3, 4}, false}, {{100, 0}, true}}, {{{1, 0}, false}}};
  EXPECT_DOUBLE_EQ(camera_rms_px(c, 0), 5);
  EXPECT_DOUBLE_EQ(camera_rms_px(c, 1), 1);
  EXPECT_DOUBLE_EQ(view_rms_px(c, 0), 5);
  c.fits[0][0].outlier = true;
  EXPECT_DOUBLE_EQ(camera_rms_px(c, 0), 0);
}

TEST(Dataset, ValidationNamesTheView) {
  Dataset good;
  good.targets = {*make_target(Chessboard{})};
  good.cameras = {{"cam", {640, 480}}};
  good.frames = {"0", "1"};
  good.views = {{0, 0, "a.png", {{0, {1, 1}}, {5, {2, 2}}}, ""}};
  ASSERT_TRUE(validate(good));
  const auto fault = [&](auto&& change) {
    Dataset bad = good;
    change(bad);
    const Status status = validate(bad);
    return status ? std::string() : status.error().text();
  };
  using ::testing::HasSubstr;
  EXPECT_THAT(fault([](Dataset& d) { d.views[0].corners[1].point = 54; }), HasSubstr("a.png"));
  EXPECT_THAT(fault([](Dataset& d) { d.views[0].corners[1].point = 0; }), HasSubstr("twice"));
  EXPECT_THAT(fault([](Dataset& d) { d.views[0].corners[0].px.x() = std::nan(""); }),
              HasSubstr("not finite"));
  EXPECT_THAT(fault([](Dataset& d) { d.views[0].corners[0].px.x() = 1e6; }), HasSubstr("outside"));
  EXPECT_THAT(fault([](Dataset& d) { d.views[0].corners[0].sigma_px = 0; }), HasSubstr("sigma"));
  EXPECT_THAT(fault([](Dataset& d) { d.views[0].frame = 2; }), HasSubstr("frame index"));
  EXPECT_THAT(fault([](Dataset& d) { d.views[0].cam = -1; }), HasSubstr("camera index"));
  EXPECT_THAT(fault([](Dataset& d) { d.views.push_back(d.views[0]); }), HasSubstr("two images"));
  EXPECT_THAT(fault([](Dataset& d) { d.views[0].target = 1; }), HasSubstr("target index 1 of 1"));
  EXPECT_THAT(fault([](Dataset& d) { d.targets.clear(); }), HasSubstr("no target"));
  EXPECT_THAT(fault([](Dataset& d) { d.targets.push_back(d.targets[0]); }), HasSubstr("have this name"));
  EXPECT_THAT(fault([](Dataset& d) {
                d.targets.push_back(*make_target(Charuco{}));
                d.targets[1].name = d.cameras[0].name;
              }),
              HasSubstr("have this name"));
  EXPECT_THAT(fault([](Dataset& d) { d.cameras[0].size = {}; }), HasSubstr("image size"));
  EXPECT_THAT(fault([](Dataset& d) { d.cameras.clear(); }), HasSubstr("no camera"));
}

TEST(Dataset, TheHashSeesEveryCorner) {
  Dataset d;
  d.cameras = {{"cam", {640, 480}}};
  d.views = {{0, 0, "a.png", {{0, {1, 1}}}, ""}};
  const std::string before = corners_hash(d);
  EXPECT_EQ(before.size(), 16U);
  EXPECT_EQ(corners_hash(d), before);
  d.views[0].corners[0].px.y() += 1e-12;
  EXPECT_NE(corners_hash(d), before);
}

}  // namespace
}  // namespace plumbline
