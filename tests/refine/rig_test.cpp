// SPDX-License-Identifier: Apache-2.0
// Rigs of many cameras and boards, from corners alone, against the simulated truth.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numeric>
#include <set>

#include "plumbline/core/linalg.hpp"
#include "refine/rig_support.hpp"
#include "refine/solve.hpp"

namespace plumbline::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

const TargetSpec kBoard = Chessboard{.columns = 7, .rows = 6, .square_m = 0.03};
const TargetSpec kOther = Chessboard{.columns = 8, .rows = 5, .square_m = 0.03};

RefineOptions options_of(const Calibration& truth) {
  RefineOptions options{.lenses = {}, .mark_outliers = false, .n_threads = 1};
  for (const Camera& camera : truth.rig.cameras) options.lenses.emplace_back(lens_name(camera.lens));
  return options;
}

std::string text_of(const Result<Calibration>& cal) { return cal ? "" : cal.error().text(); }

Lens lens_for(std::string_view name, ImageSize size, double fov_deg) {
  Lens lens = *make_lens(name, size, focal_px(size, fov_deg, name == "kb4"));
  params(lens)[2] += 3;
  params(lens)[4] = name == "kb4" ? -0.01 : -0.05;
  return lens;
}

// Boards moved by hand: what is fixed is the rig, and each frame has one board somewhere.
struct Placed {
  double azimuth_deg, distance_m;
};
RigScene hand_held(std::vector<RigCamera> cameras, const std::vector<Placed>& places, std::uint64_t seed) {
  Rng rng(seed);
  RigScene scene{std::move(cameras), {kBoard}, {SE3()}, {}};
  for (const Placed& p : places) {
    const SE3 lift(so3_exp(Vec3(rng.uniform(-0.15, 0.15), 0, 0)), Vec3::Zero());
    scene.T_rig_world.push_back(lift * board_at(p.azimuth_deg, p.distance_m, kBoard, random_tilt(rng, 35)));
  }
  return scene;
}

// Eight cameras that look outwards; only neighbours see the same board at once.
RigScene ring(std::uint64_t seed) {
  std::vector<RigCamera> cameras;
  for (int i = 0; i < 8; ++i) {
    const ImageSize size = i % 2 == 0 ? ImageSize{640, 480} : ImageSize{800, 600};
    SE3 T = camera_at(45 * i, 0.1);
    cameras.push_back({lens_for(i % 4 == 3 ? "kb4" : "opencv4", size, 75), size, T});
  }
  std::vector<Placed> places;
  for (int i = 0; i < 8; ++i) {
    for (int k = 0; k < 5; ++k) places.push_back({45.0 * i + 20 + k, 0.65 + 0.08 * k});
    for (int k = 0; k < 4; ++k) places.push_back({45.0 * i - 9 + 6 * k, 0.5 + 0.05 * k});
  }
  RigScene scene = hand_held(cameras, places, seed);
  const SE3 T_cam0_rig = scene.cameras[0].T_cam_rig;  // the rig's frame is camera 0's
  for (RigCamera& camera : scene.cameras) camera.T_cam_rig = camera.T_cam_rig * T_cam0_rig.inverse();
  for (SE3& T : scene.T_rig_world) T = T_cam0_rig * T;
  return scene;
}

// Two cameras back to back, each before a board of its own, while the rig turns about all axes.
RigScene back_to_back(int n_frames, std::uint64_t seed, double nod_deg = 18) {
  Rng rng(seed);
  const SE3 T_cam1_cam0(yaw(180) * so3_exp(Vec3(0.1, 0.05, -0.08)), Vec3(0.05, -0.02, -0.1));
  RigScene scene{
      {{lens_for("opencv5", {640, 480}, 75), {640, 480}, SE3()},
       {lens_for("kb4", {800, 600}, 100), {800, 600}, T_cam1_cam0}},
      {kBoard, kOther},
      {board_at(0, 0.7, kBoard, Vec3(0.2, -0.15, 0.1)), board_at(180, 0.75, kOther, Vec3(-0.15, 0.2, 0))},
      {}};
  for (int f = 0; f < n_frames; ++f) {
    const double nod = nod_deg * kRadPerDeg;
    const Vec3 w(rng.uniform(-nod, nod), rng.uniform(-0.3, 0.3), rng.uniform(-nod, nod));
    scene.T_rig_world.push_back(
        {so3_exp(w),
         Vec3(rng.uniform(-0.1, 0.1), nod_deg > 0 ? rng.uniform(-0.1, 0.1) : 0.0, rng.uniform(-0.1, 0.1))});
  }
  return scene;
}

// Two cameras that never see the same board at once; turned by 25 degrees the first sees both boards.
RigScene chain(std::uint64_t seed) {
  Rng rng(seed);
  RigScene scene{{{lens_for("opencv5", {640, 480}, 80), {640, 480}, SE3()},
                  {lens_for("opencv5", {1024, 768}, 75), {1024, 768}, camera_at(70, 0.05)}},
                 {kBoard, kOther},
                 {board_at(0, 0.8, kBoard, Vec3(0.2, 0, 0)), board_at(50, 0.8, kOther, Vec3(0, 0.25, 0))},
                 {}};
  for (int f = 0; f < 24; ++f) {
    const double turn = f % 2 == 0 ? rng.uniform(-4, 4) : rng.uniform(22, 28);
    scene.T_rig_world.push_back(
        {so3_exp(Vec3(rng.uniform(-0.15, 0.15), 0, rng.uniform(-0.3, 0.3))) * yaw(-turn),
         Vec3(rng.uniform(-0.06, 0.06), rng.uniform(-0.06, 0.06), rng.uniform(-0.1, 0.1))});
  }
  return scene;
}

void expect_exact(const Calibration& truth, const Result<Calibration>& cal) {
  ASSERT_TRUE(cal) << text_of(cal);
  // Without noise what is left is the solver's stopping rule.
  EXPECT_LT(cal->stats.rms_px, 1e-7);
  for (std::size_t i = 0; i < truth.rig.cameras.size(); ++i)
    EXPECT_LT(box_minus(cal->rig.T_cam_rig[i], truth.rig.T_cam_rig[i]).norm(), 1e-7) << "camera " << i;
  for (std::size_t b = 0; b < truth.data.targets.size(); ++b)
    EXPECT_LT(box_minus(cal->T_board0_board[b], truth.T_board0_board[b]).norm(), 1e-7) << "board " << b;
}

TEST(Rig, ARingOfEightIsExactWithoutNoise) {
  const Calibration truth = simulate_rig(ring(1));
  EXPECT_TRUE(share_a_board(truth.data, 0, 0));
  EXPECT_FALSE(share_a_board(truth.data, 0, 2));
  EXPECT_FALSE(share_a_board(truth.data, 1, 4));
  expect_exact(truth, calibrate(truth.data, options_of(truth)));
}

TEST(Rig, AChainThroughBoardsIsExactWithoutNoise) {
  const Calibration truth = simulate_rig(chain(2));
  ASSERT_FALSE(share_a_board(truth.data, 0, 1));
  const auto cal = calibrate(truth.data, options_of(truth));
  expect_exact(truth, cal);
  EXPECT_FALSE(cal->provenance.options.contains("joined by motion"));
}

TEST(Rig, CamerasThatNeverShareABoardAreJoinedByMotion) {
  const Calibration truth = simulate_rig(back_to_back(25, 3));
  for (const View& view : truth.data.views) {
    if (!view.corners.empty()) {
      ASSERT_EQ(view.cam, view.target);
    }
  }
  const auto cal = calibrate(truth.data, options_of(truth));
  expect_exact(truth, cal);
  EXPECT_THAT(cal->provenance.options.at("joined by motion"), HasSubstr("cam1 to cam0"));
}

// The order of cameras and boards in the data does not matter.
TEST(Rig, MotionJoinsBoardsInAnyOrder) {
  RigScene scene = back_to_back(25, 4);
  std::swap(scene.boards[0], scene.boards[1]);
  std::swap(scene.T_world_board[0], scene.T_world_board[1]);
  const Calibration truth = simulate_rig(scene);
  expect_exact(truth, calibrate(truth.data, options_of(truth)));
}

// Two stereo pairs back to back, and a fifth camera to the side with a third board: groups are joined by
// motion.
TEST(Rig, GroupsOfCamerasAreJoinedByMotion) {
  RigScene scene = back_to_back(16, 15);
  const SE3 aside(so3_exp(Vec3(0.02, -0.05, 0.01)), Vec3(-0.08, 0.01, 0.02));
  for (int i : {0, 1}) {
    scene.cameras.push_back(scene.cameras[i]);
    scene.cameras.back().T_cam_rig = aside * scene.cameras[i].T_cam_rig;
  }
  scene.cameras.push_back({lens_for("kb4", {640, 480}, 110), {640, 480}, camera_at(90, 0.05)});
  scene.boards.push_back(Chessboard{.columns = 6, .rows = 5, .square_m = 0.04});
  scene.T_world_board.push_back(board_at(90, 0.7, scene.boards[2], Vec3(0.2, 0.1, 0)));
  const Calibration truth = simulate_rig(scene);
  ASSERT_FALSE(share_a_board(truth.data, 0, 1) || share_a_board(truth.data, 4, 0) ||
               share_a_board(truth.data, 4, 1));
  ASSERT_TRUE(share_a_board(truth.data, 0, 2) && share_a_board(truth.data, 1, 3));
  const auto cal = calibrate(truth.data, options_of(truth));
  expect_exact(truth, cal);
  EXPECT_THAT(cal->provenance.options.at("joined by motion"), HasSubstr("; "));
}

// Turns that are nearly about one axis are accepted, and what they leave open is named: the vertical.
TEST(Rig, NearlyPlanarMotionNamesTheDirection) {
  const Calibration truth = simulate_rig(back_to_back(20, 16, 1.0));
  const auto cal = calibrate(with_noise(truth.data, 0.1, 2), options_of(truth));
  ASSERT_TRUE(cal) << text_of(cal);
  const detail::Offsets offsets = detail::offsets_of(*cal);
  const SymEigen shift = sym_eigen(cal->covariance->block(offsets.pose[1] + 3, offsets.pose[1] + 3, 3, 3));
  EXPECT_GT(std::abs(shift.vectors(1, 2)), 0.9);
  std::string all;
  for (const WeakDirection& weak : cal->stats.weak) all += weak.parameters + ": " + weak.consequence + "\n";
  EXPECT_THAT(all, AllOf(HasSubstr("the position of camera cam1 is known to"), HasSubstr("cam1 t_y (+")));
}

TEST(Rig, WrongViewsDoNotBendTheMotionSeed) {
  Calibration truth = simulate_rig(back_to_back(25, 5));
  Dataset data = with_noise(truth.data, 0.1, 5);
  for (View& view : data.views) {  // 2 of 25 frames: the board of cam1 as if it stood elsewhere
    if (view.cam == 1 && view.frame % 12 == 7) {
      for (Corner& c : view.corners) c.px += Vec2(60, -35);
    }
  }
  RefineOptions options = options_of(truth);
  options.mark_outliers = true;
  const auto cal = calibrate(data, options);
  ASSERT_TRUE(cal) << text_of(cal);
  const detail::Offsets offsets = detail::offsets_of(*cal);
  const Vec6 error = box_minus(cal->rig.T_cam_rig[1], truth.rig.T_cam_rig[1]);
  for (int i = 0; i < 6; ++i)
    EXPECT_LT(std::abs(error[i]),
              4 * std::sqrt((*cal->covariance)(offsets.pose[1] + i, offsets.pose[1] + i)));
}

// Chi-squared of both poses (12 numbers) against the covariance; its mean over n seeds scatters by sqrt(24 /
// n).
void expect_consistent(const std::function<RigScene(std::uint64_t)>& make, int n_seeds) {
  double sum = 0;
  for (int seed = 0; seed < n_seeds; ++seed) {
    Calibration start = simulate_rig(make(static_cast<std::uint64_t>(100 + seed)));
    const Calibration truth = start;
    start.data = with_noise(start.data, 0.2, static_cast<std::uint64_t>(seed + 1));
    const auto cal =
        refine(start, {.lenses = options_of(truth).lenses, .mark_outliers = false, .n_threads = 1});
    ASSERT_TRUE(cal) << text_of(cal);
    const detail::Offsets offsets = detail::offsets_of(*cal);
    ASSERT_EQ(offsets.board[1], offsets.pose[1] + 6);
    VecX error(12);
    error << box_minus(cal->rig.T_cam_rig[1], truth.rig.T_cam_rig[1]),
        box_minus(cal->T_board0_board[1], truth.T_board0_board[1]);
    const MatX C = cal->covariance->block(offsets.pose[1], offsets.pose[1], 12, 12);
    sum += error.dot(VecX(*solve_spd(C, error)));
  }
  EXPECT_NEAR(sum / n_seeds, 12, 3 * std::sqrt(24.0 / n_seeds));
}

TEST(Rig, ErrorsAfterMotionAreAsLargeAsPredicted) {
  expect_consistent([](std::uint64_t seed) { return back_to_back(15, seed); }, 24);
}
TEST(Rig, ErrorsThroughAChainAreAsLargeAsPredicted) { expect_consistent(chain, 24); }

// The block solver and the reference on further boards, off the truth by some centimetres and degrees.
TEST(Rig, BothSolversReachTheSameOptimum) {
  for (const RigScene& scene : {chain(11), back_to_back(15, 12)}) {
    Calibration start = simulate_rig(scene);
    start.data = with_noise(start.data, 0.3, 13);
    Rng rng(14);
    const auto push = [&](SE3& T) {
      Vec6 d;
      for (double& x : d) x = rng.normal(0.01);
      T = box_plus(T, d);
    };
    push(start.rig.T_cam_rig[1]);
    push(start.T_board0_board[1]);
    for (auto& T : start.T_rig_board) push(*T);
    for (const Loss loss : {Loss::kSquared, Loss::kCauchy}) {
      Calibration blocks = start, ceres = start;
      detail::SolveSpec spec{.loss = loss, .loss_scale = 0.5, .max_iterations = 1000};
      const detail::SolveReport a = detail::solve(blocks, spec);
      spec.solver = Solver::kCeres;
      const detail::SolveReport b = detail::solve(ceres, spec);
      ASSERT_TRUE(a.usable && b.usable) << a.termination << " / " << b.termination;
      EXPECT_NEAR(a.cost, b.cost, 1e-9 * b.cost) << a.termination << " / " << b.termination;
      // Where the cost is flat to 1e-9 of it, poses agree to some 1e-5.
      EXPECT_LT(box_minus(blocks.T_board0_board[1], ceres.T_board0_board[1]).norm(), 1e-4);
    }
  }
}

TEST(Rig, TwoBoardsBeforeOneCamera) {
  RigScene scene = chain(6);
  scene.cameras.resize(1);
  const Calibration truth = simulate_rig(scene);
  expect_exact(truth, calibrate(truth.data, options_of(truth)));
  // As many names as the covariance has rows, and the board's behind the lens'.
  const auto names = shared_parameter_names(truth);
  ASSERT_EQ(names.size(), 9 + 6);
  EXPECT_EQ(names[9], "boardB r_x");
  EXPECT_EQ(names.back(), "boardB t_z");
  const auto cal = calibrate(with_noise(truth.data, 0.1, 1), options_of(truth));
  ASSERT_TRUE(cal) << text_of(cal);
  EXPECT_EQ(cal->covariance->rows(), 15);
  EXPECT_GT((*cal->covariance)(14, 14), 0);
}

TEST(Rig, HoldsABoardByName) {
  RigScene scene = chain(6);
  scene.cameras.resize(1);
  const Calibration truth = simulate_rig(scene);
  Calibration start = truth;
  start.data = with_noise(start.data, 0.2, 3);
  RefineOptions options = options_of(truth);
  options.fixed = {"boardB t_x", "boardB t_y", "boardB t_z"};
  const auto cal = refine(start, options);
  ASSERT_TRUE(cal) << text_of(cal);
  EXPECT_EQ(cal->T_board0_board[1].t(), truth.T_board0_board[1].t());
  EXPECT_GT(box_minus(cal->T_board0_board[1], truth.T_board0_board[1]).norm(), 1e-7);
  EXPECT_EQ((*cal->covariance)(14, 14), 0);
}

// Boards shown one after the other never share a frame: their pose to each other says nothing, and the lens
// must not suffer.
TEST(Rig, BoardsThatNeverShareAFrameAreHeldAndSaid) {
  Rng rng(7);
  RigScene scene{{{lens_for("opencv5", {640, 480}, 60), {640, 480}, SE3()}}, {kBoard}, {SE3()}, {}};
  for (int f = 0; f < 10; ++f)
    scene.T_rig_world.push_back(board_at(rng.uniform(-10, 10), 0.6, kBoard, random_tilt(rng, 40)));
  Calibration truth = simulate_rig(scene);
  scene.boards = {kOther};
  scene.T_rig_world.clear();
  for (int f = 0; f < 10; ++f)
    scene.T_rig_world.push_back(board_at(rng.uniform(-10, 10), 0.6, kOther, random_tilt(rng, 40)));
  const Calibration other = simulate_rig(scene);
  truth.data.targets.push_back(*make_target(kOther, "boardB"));
  for (View view : other.data.views) {
    view.frame += 10;
    view.target = 1;
    truth.data.frames.push_back("g" + std::to_string(view.frame));
    truth.data.views.push_back(view);
  }
  const auto cal = calibrate(truth.data, options_of(truth));
  ASSERT_TRUE(cal) << text_of(cal);
  EXPECT_LT(cal->stats.rms_px, 1e-7);
  EXPECT_NEAR(params(cal->rig.cameras[0].lens)[0], params(truth.rig.cameras[0].lens)[0], 1e-5);
  ASSERT_FALSE(cal->stats.weak.empty());
  EXPECT_THAT(cal->stats.weak.back().consequence,
              AllOf(HasSubstr("no frame shows board boardB"), HasSubstr("boardA")));
}

std::string refusal_of(const Dataset& data, const Calibration& truth) {
  const auto cal = calibrate(data, options_of(truth));
  if (cal) return "accepted";
  return std::string(to_string(cal.error().code)) + " " + cal.error().text();
}

TEST(Rig, ABrokenRingNamesTheGroupsAndTheFramesThatWouldMendIt) {
  const Calibration truth = simulate_rig(ring(1));
  Dataset data = truth.data;
  data.cameras.resize(4);
  std::erase_if(data.views, [](const View& v) { return v.cam >= 4; });
  // Cameras 1 and 2 lose what they share: camera 2 finds no board where camera 1 sees it.
  std::set<int> seen_by_1;
  for (const View& v : data.views) {
    if (v.cam == 1 && !v.corners.empty()) seen_by_1.insert(v.frame);
  }
  for (View& v : data.views) {
    if (v.cam == 2 && seen_by_1.contains(v.frame) && !v.corners.empty()) {
      v.corners.clear();
      v.reason = "no 7x6 chessboard found";
    }
  }
  Calibration four = truth;
  four.rig.cameras.resize(4);
  const std::string near = fmt::format(
      "cam1 and cam2 share none: {} frames show the board to cam1 only (f{}, f{}, f{}, ...)",
      seen_by_1.size(), *seen_by_1.begin(), *std::next(seen_by_1.begin()), *std::next(seen_by_1.begin(), 2));
  EXPECT_THAT(refusal_of(data, four),
              AllOf(HasSubstr("kDegenerate"), HasSubstr("[cam0, cam1] and [cam2, cam3]"), HasSubstr(near),
                    HasSubstr("take images in which")));
}

TEST(Rig, CamerasWithoutACommonFrameAreToldToCheckTheNames) {
  Calibration truth = simulate_rig(back_to_back(20, 8));
  Dataset data = truth.data;
  std::erase_if(data.views, [](const View& v) { return v.frame % 2 != v.cam; });
  EXPECT_THAT(refusal_of(data, truth), AllOf(HasSubstr("cam0 and cam1"), HasSubstr("boardA in 10 frames"),
                                             HasSubstr("--cam patterns")));
}

TEST(Rig, PlanarMotionIsRefusedWithTheAxis) {
  const Calibration truth = simulate_rig(back_to_back(20, 9, 0));
  EXPECT_THAT(refusal_of(with_noise(truth.data, 0.1, 1), truth),
              AllOf(HasSubstr("kDegenerate"), HasSubstr("cam0 and cam1"), HasSubstr("about one axis"),
                    HasSubstr("1.00"), HasSubstr("turn the whole rig about two axes")));
}

TEST(Rig, SaysWhenACameraHangsOnOneFrame) {
  const Calibration truth = simulate_rig(ring(1));
  Dataset data = truth.data;
  data.cameras.resize(2);
  std::erase_if(data.views, [](const View& v) { return v.cam >= 2; });
  std::set<int> of_1;
  for (const View& v : data.views) {
    if (v.cam == 1 && !v.corners.empty()) of_1.insert(v.frame);
  }
  int kept = -1;
  std::erase_if(data.views, [&](const View& v) {
    if (v.cam != 0 || v.corners.empty() || !of_1.contains(v.frame)) return false;
    if (kept < 0) kept = v.frame;
    return v.frame != kept;
  });
  ASSERT_GE(kept, 0);
  Calibration two = truth;
  two.rig.cameras.resize(2);
  const auto cal = calibrate(with_noise(data, 0.1, 1), options_of(two));
  ASSERT_TRUE(cal) << text_of(cal);
  std::string all;
  for (const WeakDirection& weak : cal->stats.weak) all += weak.parameters + ": " + weak.consequence + "\n";
  EXPECT_THAT(all, HasSubstr(fmt::format(
                       "camera cam1 is joined to camera cam0 by 1 frame: f{} (seen by cam0, cam1)", kept)));
}

// Far boards straight ahead, all at one distance: the second camera may move sideways when it turns. The
// named direction is that in which the estimates scatter.
TEST(Rig, NamesTheWeakDirection) {
  Rng rng(10);
  const Lens lens = lens_for("opencv4", {640, 480}, 20);
  RigScene scene{{{lens, {640, 480}, SE3()}, {lens, {640, 480}, SE3(Mat3::Identity(), {-0.1, 0, 0})}},
                 {kBoard},
                 {SE3()},
                 {}};
  for (int f = 0; f < 4; ++f) scene.T_rig_world.push_back(board_at(0.5, 1.5, kBoard, random_tilt(rng, 30)));
  const Calibration truth = simulate_rig(scene);
  Calibration start = truth;
  RefineOptions options = options_of(truth);  // good lenses: what is left is the rig
  options.fixed = {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"};
  constexpr int kSeeds = 60;
  double scatter = 0;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    start.data = with_noise(truth.data, 1.0, static_cast<std::uint64_t>(seed));
    const auto cal = refine(start, options);
    ASSERT_TRUE(cal) << text_of(cal);
    const int at = detail::offsets_of(*cal).pose[1] + 3;
    const SymEigen shift = sym_eigen(cal->covariance->block(at, at, 3, 3));
    const Vec3 worst = shift.vectors.col(2);
    EXPECT_LT(std::abs(worst.z()), 0.2);
    const Vec3 error = box_minus(cal->rig.T_cam_rig[1], truth.rig.T_cam_rig[1]).tail<3>();
    scatter += std::pow(error.dot(worst), 2) / shift.values[2];
    std::string all;
    for (const WeakDirection& weak : cal->stats.weak) all += weak.parameters + ": " + weak.consequence + "\n";
    const double sign = worst.z() < 0 ? -1 : 1;
    EXPECT_THAT(
        all, AllOf(HasSubstr("the position of camera cam1 is known to"),
                   HasSubstr(fmt::format("along ({:.2f}, {:.2f}, {:.2f}); add frames in which both cameras "
                                         "see the board, near and far",
                                         sign * worst.x(), sign * worst.y(), sign * worst.z()))));
  }
  EXPECT_NEAR(scatter / kSeeds, 1, 3 * std::sqrt(2.0 / kSeeds));  // chi-squared of one number
}

}  // namespace
}  // namespace plumbline::test
