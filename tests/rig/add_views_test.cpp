// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rig/add_views.hpp"

#include <gmock/gmock.h>

#include "plumbline/rig/motion.hpp"

namespace plumbline::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

Dataset two_cameras(const std::string& folder, int n_frames) {
  Dataset data;
  data.targets = {*make_target(Chessboard{.columns = 9, .rows = 6, .square_m = 0.025})};
  data.cameras = {{"left", {640, 480}}, {"right", {640, 480}}};
  for (int f = 0; f < n_frames; ++f) data.frames.push_back("0" + std::to_string(f));
  for (int cam = 0; cam < 2; ++cam) {
    for (int f = 0; f < n_frames; ++f) {
      const std::string image = folder + data.cameras[cam].name + "0" + std::to_string(f) + ".png";
      data.views.push_back({cam, f, image, {{f, Vec2(f, cam), 1.0}}, ""});
    }
  }
  return data;
}

Calibration old_calibration() {
  Calibration cal;
  cal.data = two_cameras("", 3);
  for (const CameraInfo& info : cal.data.cameras)
    cal.rig.cameras.push_back({info.name, info.size, *make_lens("pinhole", info.size, 500)});
  cal.rig.T_cam_rig = {SE3(), SE3(Mat3::Identity(), Vec3(-0.1, 0, 0))};
  cal.T_rig_board = {SE3(), std::nullopt, SE3(Mat3::Identity(), Vec3(0, 0, 1))};
  return cal;
}

TEST(AddViews, NewFoldersMakeNewFrames) {
  const Calibration old = old_calibration();
  const auto cal = add_views(old, two_cameras("new/", 2), false);
  ASSERT_TRUE(cal) << cal.error().text();
  EXPECT_THAT(cal->data.frames, ElementsAre("00", "01", "02", "00 (2)", "01 (2)"));
  ASSERT_EQ(cal->data.views.size(), 10u);
  for (const View& view : cal->data.views)
    EXPECT_EQ(view.frame >= 3, view.image.starts_with("new/")) << view.image;
  EXPECT_EQ(cal->T_rig_board[2], old.T_rig_board[2]);
  EXPECT_FALSE(cal->T_rig_board[3]);
  EXPECT_EQ(cal->fits.size(), 10u);
  EXPECT_EQ(cal->data.views.front().cam, 0);
  EXPECT_EQ(cal->data.views.back().cam, 1);
}

TEST(AddViews, AnImageThatIsThereIsReplacedOnRequestOnly) {
  const Calibration old = old_calibration();
  Dataset more = two_cameras("", 1);
  more.frames = {"again"};
  more.views.pop_back();  // left00.png alone
  more.views[0].corners[0].px = Vec2(77, 78);
  const auto refused = add_views(old, more, false);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("left00.png"));
  const auto cal = add_views(old, more, true);
  ASSERT_TRUE(cal) << cal.error().text();
  EXPECT_EQ(cal->data.views.size(), 6u);
  EXPECT_THAT(cal->data.frames, ElementsAre("00", "01", "02"));
  EXPECT_EQ(cal->data.views[0].corners[0].px, Vec2(77, 78));
  EXPECT_FALSE(cal->T_rig_board[0]);  // it may have moved
  EXPECT_TRUE(cal->T_rig_board[2]);
}

// Twenty-five frames a second from a zero of its own; the right camera is 3 ms late.
Dataset recording(const std::string& folder, int n_frames, double start_s) {
  Dataset data = two_cameras(folder, n_frames);
  for (View& view : data.views) view.time_s = start_s + 0.04 * view.frame + 0.003 * view.cam;
  return data;
}

// Both count from zero, so that the second begins in the middle of the first, or within a gap of its end: no
// frame's motion may be read from the other recording.
TEST(AddViews, EachRecordingHasItsOwnTimes) {
  for (const double start_s : {0.0, 0.25}) {
    Calibration old = old_calibration();
    old.data = recording("", 6, 0);
    old.T_rig_board.assign(6, SE3());
    const Dataset more = recording("new/", 7, start_s);
    auto cal = add_views(old, more, false);
    ASSERT_TRUE(cal) << cal.error().text();
    cal->T_rig_board.assign(cal->data.frames.size(), SE3());
    const Trajectory trajectory = trajectory_of(*cal);
    for (int f = 0; f < 13; ++f) {
      ASSERT_TRUE(trajectory.stencils[f]) << f;
      for (int other : trajectory.stencils[f]->frames) EXPECT_EQ(other < 6, f < 6) << f;
    }
    for (const View& view : cal->data.views) {
      if (view.frame < 6) continue;
      // What separates frames and cameras of one recording stays, to the digits of a double.
      EXPECT_NEAR(*view.time_s - *trajectory.time_s[6], 0.04 * (view.frame - 6) + 0.003 * view.cam, 1e-12);
    }
  }
}

TEST(AddViews, ReplacedImagesKeepTheirTimes) {
  Calibration old = old_calibration();
  old.data = recording("", 6, 0.5);
  old.T_rig_board.assign(6, SE3());
  Dataset more = recording("", 7, 100.25);  // the same recording by another zero, and a frame more
  const auto cal = add_views(old, more, true);
  ASSERT_TRUE(cal) << cal.error().text();
  for (const View& view : cal->data.views)
    EXPECT_NEAR(*view.time_s, 0.5 + 0.04 * view.frame + 0.003 * view.cam, 1e-12) << view.image;
  Dataset untimed = more;  // detected again, and nobody says when
  for (View& view : untimed.views) view.time_s.reset();
  const auto kept = add_views(old, untimed, true);
  ASSERT_TRUE(kept) << kept.error().text();
  for (const View& view : kept->data.views) {
    ASSERT_EQ(view.time_s.has_value(), view.frame < 6) << view.image;
    if (view.time_s) {
      EXPECT_NEAR(*view.time_s, 0.5 + 0.04 * view.frame + 0.003 * view.cam, 1e-12) << view.image;
    }
  }
  *more.views[3].time_s += 0.01;
  EXPECT_THAT(add_views(old, more, true).error().text(),
              testing::AllOf(HasSubstr("left03.png"), HasSubstr("0.130000 s"), HasSubstr("0.120000 s")));
}

TEST(AddViews, RefusesWhatDoesNotBelong) {
  const Calibration old = old_calibration();
  Dataset more = two_cameras("new/", 1);
  more.cameras[1].name = "middle";
  EXPECT_THAT(add_views(old, more, false).error().text(), HasSubstr("left, right"));
  more = two_cameras("new/", 1);
  more.cameras[1].size = {320, 240};
  EXPECT_THAT(add_views(old, more, false).error().text(), HasSubstr("320x240"));
  more = two_cameras("new/", 1);
  more.targets = {*make_target(Chessboard{.columns = 8, .rows = 6, .square_m = 0.025})};
  EXPECT_THAT(add_views(old, more, false).error().text(), HasSubstr("8x6"));
  // one replaced, the other of its frame new: both of that frame, which then has two images of one camera
  more = two_cameras("", 1);
  more.views[1].image = "other.png";
  EXPECT_THAT(add_views(old, more, true).error().text(), HasSubstr("two images"));
}

}  // namespace
}  // namespace plumbline::test
