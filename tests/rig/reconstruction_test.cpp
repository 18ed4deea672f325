// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rig/reconstruction.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <functional>

#include "plumbline/geometry/so3.hpp"

namespace plumbline {
namespace {

using ::testing::HasSubstr;

Reconstruction small() {
  Reconstruction scene;
  scene.cameras = {{"left", {640, 480}, *make_lens("opencv4", {640, 480}, 500)}};
  scene.views = {{0, "a.jpg", SE3(), 7}, {0, "", SE3(so3_exp({0, 0.1, 0}), {-0.2, 0, 0}), -1}};
  scene.p_world = {{0, 0, 2}, {0.1, 0.2, 3}};
  scene.sightings = {{0, 0, {320, 240}, 1}, {1, 1, {310, 230}, 0.5}};
  scene.tags = {{12, {1, 2, 3}}, {}};
  return scene;
}

TEST(Reconstruction, PredictIsTheLensOfTheMovedPoint) {
  const Reconstruction scene = small();
  // By hand: the axis' point lies on the centre of a 640 x 480 image.
  EXPECT_EQ(*predict(scene, scene.sightings[0]), Vec2(319.5, 239.5));
  Reconstruction behind = scene;
  behind.p_world[0].z() = -2;
  EXPECT_FALSE(predict(behind, behind.sightings[0]));
}

TEST(Reconstruction, NamesSayWhatFilesCalledThem) {
  const Reconstruction scene = small();
  EXPECT_EQ(view_name(scene, 0), "view 0 (a.jpg)");
  EXPECT_EQ(view_name(scene, 1), "view 1");
  EXPECT_EQ(point_name(scene, 0), "point 0 (id 12)");
  EXPECT_EQ(point_name(scene, 1), "point 1");
}

TEST(Reconstruction, FaultsAreNamed) {
  EXPECT_TRUE(validate(small()));
  const double nan = std::nan("");
  const std::pair<std::function<void(Reconstruction&)>, const char*> cases[] = {
      {[](Reconstruction& s) { s.cameras.clear(); }, "no camera"},
      {[](Reconstruction& s) { params(s.cameras[0].lens)[0] = -1; }, "camera left: focal lengths -1"},
      {[&](Reconstruction& s) { params(s.cameras[0].lens)[5] = nan; }, "camera left: a parameter"},
      {[](Reconstruction& s) { s.cameras[0].size.width = -1; }, "image size -1x480"},
      {[](Reconstruction& s) { s.views[0].camera = 1; }, "view 0 (a.jpg): camera index 1 of 1"},
      {[&](Reconstruction& s) { s.views[1].T_cam_world.qt[5] = nan; }, "view 1: its pose is not finite"},
      {[](Reconstruction& s) { s.views[1].T_cam_world.qt[0] = 2; },
       "view 1: its quaternion has the length 2"},
      {[&](Reconstruction& s) { s.p_world[1].y() = nan; }, "point 1: its coordinates"},
      {[](Reconstruction& s) { s.sightings[1].point = 2; }, "sighting 1: point index 2 of 2"},
      {[](Reconstruction& s) { s.sightings[1].view = -1; }, "sighting 1: view index -1 of 2"},
      {[&](Reconstruction& s) { s.sightings[0].px.x() = nan; }, "sighting 0: its pixel"},
      {[](Reconstruction& s) { s.sightings[0].sigma_px = 0; }, "sighting 0: sigma 0 px"},
      {[](Reconstruction& s) { s.tags.pop_back(); }, "1 tags for 2 points"},
  };
  for (const auto& [spoil, words] : cases) {
    Reconstruction scene = small();
    spoil(scene);
    const auto status = validate(scene);
    ASSERT_FALSE(status) << words;
    EXPECT_EQ(status.error().code, ErrorCode::kInvalidData);
    EXPECT_THAT(status.error().text(), HasSubstr(words));
  }
}

}  // namespace
}  // namespace plumbline
