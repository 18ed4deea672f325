// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/start.hpp"

#include <gmock/gmock.h>

#include "plumbline/assess/compare.hpp"
#include "refine/refine_support.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

double worst_px(const Lens& a, const Lens& b) {
  const ImageSize size{640, 480};
  const auto diff = compare_cameras({"a", size, a}, {"b", size, b});
  return diff ? diff->max : 1e9;
}

TEST(ConvertLens, IsExactWhereOneContainsTheOther) {
  for (const auto& [from, to] : {std::pair{"pinhole", "opencv5"},
                                 {"opencv4", "opencv5"},
                                 {"opencv5", "opencv8"},
                                 {"opencv8", "opencv12"}}) {
    const Lens lens = example_lens(from);
    const auto converted = convert_lens(lens, to, {640, 480});
    ASSERT_TRUE(converted) << converted.error().text();
    EXPECT_EQ(lens_name(*converted), to);
    // Rational terms that nothing asks for leave a flat valley; its floor is what is compared.
    EXPECT_LT(worst_px(lens, *converted), 1e-3) << from << " " << to;
  }
  const Lens same = example_lens("kb4");
  EXPECT_TRUE(std::ranges::equal(params(*convert_lens(same, "kb4", {640, 480})), params(same)));
}

TEST(ConvertLens, ComesNearOtherwise) {
  const auto fisheye = convert_lens(example_lens("opencv5"), "kb4", {640, 480});
  ASSERT_TRUE(fisheye);
  // tangential terms of 1e-3 alone are 0.3 px at the corner
  EXPECT_LT(worst_px(example_lens("opencv5"), *fisheye), 1.5);
  const Lens wide = *make_lens("kb4", std::vector<double>{300, 301, 322, 238, -0.02, 0.005, 0, 0});
  const auto rational = convert_lens(wide, "opencv8", {640, 480});
  ASSERT_TRUE(rational);
  EXPECT_LT(worst_px(wide, *rational), 0.5);
  EXPECT_EQ(convert_lens(wide, "opencv6", {640, 480}).error().code, ErrorCode::kUnsupported);
}

class StartFromRig : public ::testing::Test {
 protected:
  StartFromRig()
      : sim(simulate({.lenses = {example_lens("opencv5"), example_lens("opencv5"), example_lens("opencv5")},
                      .n_frames = 10,
                      .seed = 21})),
        data(with_noise(sim.truth.data, 0.1, 22)) {}
  void expect_optimum(const Result<Calibration>& start) const {
    ASSERT_TRUE(start) << start.error().text();
    const auto cal = refine(*start, {});
    ASSERT_TRUE(cal) << cal.error().text();
    EXPECT_NEAR(cal->stats.rms_xy_px, 0.1, 0.01);
    EXPECT_LT(box_minus(cal->rig.T_cam_rig[2], sim.truth.rig.T_cam_rig[2]).norm(), 2e-3);
  }
  Simulation sim;
  Dataset data;
};

TEST_F(StartFromRig, WithKnownPlacesFindsTheBoards) {
  const auto start = start_from(data, sim.truth.rig, {});
  expect_optimum(start);
  EXPECT_EQ(start->rig.T_cam_rig[1].qt, sim.truth.rig.T_cam_rig[1].qt);
  for (std::size_t f = 0; f < data.frames.size(); ++f) {
    if (start->T_rig_board[f])
      EXPECT_LT(box_minus(*start->T_rig_board[f], *sim.truth.T_rig_board[f]).norm(), 0.02);
  }
}

TEST_F(StartFromRig, WithoutPlacesFindsThem) {
  Rig rig = sim.truth.rig;
  for (SE3& T : rig.T_cam_rig) T = SE3();
  expect_optimum(start_from(data, rig, {.places_known = false}));
}

TEST_F(StartFromRig, InAnotherOrderAndWithAnotherLens) {
  Rig rig = sim.truth.rig;
  std::swap(rig.cameras[0], rig.cameras[2]);
  std::swap(rig.T_cam_rig[0], rig.T_cam_rig[2]);
  std::vector<std::optional<SE3>> known(data.frames.size());
  known[3] = sim.truth.T_rig_board[3];
  const auto start = start_from(data, rig, {.lenses = {"opencv8"}, .T_rig_board = known});
  ASSERT_TRUE(start) << start.error().text();
  EXPECT_EQ(start->rig.cameras[0].name, "cam0");
  EXPECT_EQ(lens_name(start->rig.cameras[1].lens), "opencv8");
  EXPECT_LT(box_minus(start->rig.T_cam_rig[2], sim.truth.rig.T_cam_rig[2]).norm(), 1e-12);
  // Known in the frame of the file's rig, which here is still that of cam0.
  EXPECT_LT(box_minus(*start->T_rig_board[3], *sim.truth.T_rig_board[3]).norm(), 1e-12);
}

TEST_F(StartFromRig, WrongCornersDoNotMoveTheBoards) {
  Rng rng(1);
  for (View& view : data.views) {
    for (int k = 0; k < 4; ++k)
      view.corners[rng.index(static_cast<int>(view.corners.size()))].px =
          Vec2(rng.uniform(0, 639), rng.uniform(0, 479));
  }
  expect_optimum(start_from(data, sim.truth.rig, {}));
}

TEST_F(StartFromRig, RefusesWhatDoesNotBelong) {
  Rig rig = sim.truth.rig;
  rig.cameras[1].name = "other";
  EXPECT_THAT(start_from(data, rig, {}).error().text(), HasSubstr("cam0, other, cam2"));
  rig = sim.truth.rig;
  rig.cameras[2].size = {320, 240};
  EXPECT_THAT(start_from(data, rig, {}).error().text(), HasSubstr("320x240"));
  EXPECT_EQ(start_from(data, sim.truth.rig, {.lenses = {"opencv6"}}).error().code, ErrorCode::kUnsupported);
}

// A name for one camera leaves the other what it has, to the last bit.
TEST(StartFrom, AnEmptyNameKeepsTheLensOfTheStart) {
  const Calibration truth =
      simulate({.lenses = {example_lens("opencv5"), example_lens("kb4")}, .n_frames = 6}).truth;
  const auto start = start_from(truth.data, truth.rig, {.lenses = {"opencv8", ""}});
  ASSERT_TRUE(start) << start.error().text();
  EXPECT_EQ(lens_name(start->rig.cameras[0].lens), "opencv8");
  EXPECT_EQ(lens_name(start->rig.cameras[1].lens), "kb4");
  EXPECT_TRUE(std::ranges::equal(params(start->rig.cameras[1].lens), params(truth.rig.cameras[1].lens)));
}

}  // namespace
}  // namespace plumbline::test
