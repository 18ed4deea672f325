// SPDX-License-Identifier: Apache-2.0
// White box: the block solver against the reference, which is Ceres on the same problem.
#include "refine/block_solve.hpp"

#include <gtest/gtest.h>

#include "refine/block_support.hpp"

namespace plumbline::test {
namespace {

using namespace detail;

std::string lens_of(int i) { return std::string(fixed_lens_names()[static_cast<std::size_t>(i)]); }

class BlockSolveLens : public ::testing::TestWithParam<int> {};

// A rational lens has a valley that Ceres does not walk to its end in a thousand iterations; from ours it
// must not find anything lower. With few views the optimum lies where the lens folds, and is no minimum.
void expect_ceres_confirms(const Calibration& start, SolveSpec spec) {
  Calibration blocks = start, ceres = start;
  const SolveReport a = solve_blocks(blocks, spec);
  ASSERT_TRUE(a.usable && a.converged) << a.termination;
  EXPECT_LT(a.iterations, 200);
  spec.max_iterations = 50;
  EXPECT_LE(a.cost, solve_ceres(ceres, spec).cost * (1 + 1e-9));
  EXPECT_GE(solve_ceres(blocks, spec).cost, a.cost * (1 - 1e-9));
}

TEST_P(BlockSolveLens, ReachesCeresOptimum) {
  const Lens lens = example_lens(lens_of(GetParam()));
  const bool rational = n_params(lens) >= 12;
  for (const Loss loss : {Loss::kSquared, Loss::kHuber, Loss::kCauchy}) {
    const SolveSpec spec{.loss = loss, .loss_scale = 0.5, .max_iterations = 1000};
    const Calibration start =
        start_of({.lenses = {lens}, .n_frames = rational ? 100 : 20, .seed = 3}, 0.1, 5);
    rational ? expect_ceres_confirms(start, spec) : expect_same_optimum(start, spec);
  }
}

TEST_P(BlockSolveLens, ReachesCeresOptimumOfARig) {
  const std::string name = lens_of(GetParam());
  const Calibration start = start_of(
      {.lenses = {example_lens(name), example_lens("kb4"), example_lens(name)}, .n_frames = 12, .seed = 4},
      0.3, 6);
  expect_same_optimum(start, {.max_iterations = 1000});
}

// Its steps are those of the cost that Ceres sees: gradients of both vanish together.
TEST_P(BlockSolveLens, IsExactWithoutNoise) {
  const Scene scene{.lenses = {example_lens(lens_of(GetParam())), example_lens(lens_of(GetParam()))},
                    .seed = 7};
  const Simulation sim = simulate(scene);
  Calibration cal = start_of(scene, 0.0, 8);
  const SolveReport report = solve_blocks(cal, {.max_iterations = 1000});
  ASSERT_TRUE(report.usable) << report.termination;
  EXPECT_LT(worst_lens_error_px(sim, cal), 1e-6);
}

INSTANTIATE_TEST_SUITE_P(All, BlockSolveLens,
                         ::testing::Range(0, static_cast<int>(fixed_lens_names().size())),
                         [](const auto& kind) { return lens_of(kind.param); });

TEST(BlockSolve, WeighsBySigma) {
  Calibration start = start_of({.lenses = {example_lens("opencv5")}}, 0.3, 9);
  Rng rng(10);
  for (View& view : start.data.views)
    for (Corner& c : view.corners) c.sigma_px = rng.uniform(0.1, 1);
  expect_same_optimum(start, {.use_sigma = true});
}

TEST(BlockSolve, LeavesOutMarkedCornersAndUnusedFrames) {
  Calibration start = start_of({.lenses = {example_lens("opencv5"), example_lens("opencv4")}}, 0.3, 11);
  start.fits[3].clear();
  start.T_rig_board[5].reset();
  for (int i = 0; i < 10; ++i) {
    start.fits[0][static_cast<std::size_t>(i)].outlier = true;
    start.data.views[0].corners[static_cast<std::size_t>(i)].px.x() += 100;
  }
  expect_same_optimum(start, {});
}

TEST(BlockSolve, HoldsWhatIsHeld) {
  const Calibration start = start_of({.lenses = {example_lens("opencv5"), example_lens("opencv5")}}, 0.3, 12);
  const std::size_t n = shared_parameter_names(start.rig).size();
  SolveSpec spec;
  spec.held.assign(n, false);
  for (const std::size_t i : {1, 8, 9 + 2, 18 + 3, 18 + 5})
    spec.held[i] = true;  // left fy, k3; right cx; t_x, t_z
  Calibration cal = start;
  ASSERT_TRUE(solve_blocks(cal, spec).usable);
  EXPECT_EQ(params(cal.rig.cameras[0].lens)[1], params(start.rig.cameras[0].lens)[1]);
  EXPECT_EQ(params(cal.rig.cameras[0].lens)[8], params(start.rig.cameras[0].lens)[8]);
  EXPECT_EQ(params(cal.rig.cameras[1].lens)[2], params(start.rig.cameras[1].lens)[2]);
  EXPECT_EQ(cal.rig.T_cam_rig[1].t().x(), start.rig.T_cam_rig[1].t().x());
  EXPECT_EQ(cal.rig.T_cam_rig[1].t().z(), start.rig.T_cam_rig[1].t().z());
  expect_same_optimum(start, spec);
  spec.held.assign(n, true);  // poses alone
  expect_same_optimum(start, spec);
  spec.held.assign(n, false);
  spec.hold_boards = true;
  expect_same_optimum(start, spec);
}

TEST(BlockSolve, TiesParameters) {
  Calibration start = start_of({.lenses = {example_lens("opencv5"), example_lens("opencv5")}}, 0.3, 17);
  SolveSpec spec;
  for (int i = 0; i < 24; ++i) spec.tied_to.push_back(i);
  spec.tied_to[1] = 0;                                  // left fy = left fx
  for (int i = 4; i < 9; ++i) spec.tied_to[9 + i] = i;  // one distortion for both
  spec.held.assign(24, false);
  spec.held[8] = spec.held[17] = true;
  const auto left = params(start.rig.cameras[0].lens), right = params(start.rig.cameras[1].lens);
  left[1] = left[0];
  std::copy(left.begin() + 4, left.end(), right.begin() + 4);
  Calibration cal = start;
  ASSERT_TRUE(solve_blocks(cal, spec).usable);
  EXPECT_EQ(params(cal.rig.cameras[0].lens)[1], params(cal.rig.cameras[0].lens)[0]);
  for (std::size_t i = 4; i < 9; ++i)
    EXPECT_EQ(params(cal.rig.cameras[1].lens)[i], params(cal.rig.cameras[0].lens)[i]);
  expect_same_optimum(start, spec);
}

TEST(BlockSolve, HeedsPriors) {
  const Calibration start =
      start_of({.lenses = {example_lens("opencv5"), example_lens("opencv4")}, .n_frames = 8}, 0.3, 18);
  SolveSpec spec;
  spec.priors = {{0, 560, 0.5},     {2, 330, 0.2},      {9, 548, 1},
                 {17, 0.01, 0.002}, {18, -0.04, 0.001}, {20, -0.1, 1e-4}};
  spec.prior_weight = 0.3;
  Calibration with = start, without = start;
  const SolveReport report = solve_blocks(with, spec);
  ASSERT_TRUE(report.converged) << report.termination;
  ASSERT_TRUE(solve_blocks(without, {}).converged);
  EXPECT_GT(std::abs(params(with.rig.cameras[0].lens)[0] - params(without.rig.cameras[0].lens)[0]), 0.1);
  expect_same_optimum(start, spec);
}

TEST(BlockSolve, LeavesHalfHeldRotationsToCeres) {
  Calibration start = start_of({.lenses = {example_lens("opencv4"), example_lens("opencv4")}}, 0.3, 13);
  SolveSpec spec;
  spec.held.assign(shared_parameter_names(start.rig).size(), false);
  EXPECT_TRUE(block_solver_can(start, spec));
  spec.held[16] = true;
  EXPECT_FALSE(block_solver_can(start, spec));
  const Vec3 before = so3_log(start.rig.T_cam_rig[1].R());
  ASSERT_TRUE(solve(start, spec).usable);
  EXPECT_NEAR(so3_log(start.rig.T_cam_rig[1].R()).x(), before.x(), 1e-12);
}

TEST(BlockSolve, TakesSeveralBoards) {
  Calibration start =
      start_of({.lenses = {example_lens("opencv5"), example_lens("kb4")}, .n_frames = 30}, 0.3, 16);
  // The board twice: what the views of odd frames saw is said to be a second board, somewhere else.
  start.data.targets.push_back(start.data.targets[0]);
  start.data.targets[1].name = "second";
  start.T_board0_board.push_back(SE3(so3_exp(Vec3(0.3, -0.2, 0.5)), Vec3(0.1, 0.05, 0.02)));
  for (View& view : start.data.views) {
    if (view.frame % 3 == 1) view.target = 1;
    if (view.frame % 3 == 2) view.target = view.cam;  // ties the two boards together
  }
  for (std::size_t f = 0; f < start.T_rig_board.size(); ++f) {
    if (f % 3 == 1) start.T_rig_board[f] = *start.T_rig_board[f] * start.T_board0_board[1].inverse();
  }
  for (std::size_t v = 0; v < start.data.views.size(); ++v) {
    const View& view = start.data.views[v];
    if (view.frame % 3 != 2 || view.cam != 1) continue;
    // Seen from where the second board stands.
    for (Corner& c : start.data.views[v].corners) {
      const auto px = predict(start, view, c.point);
      if (px) c.px = *px + Vec2(0.1 * std::sin(c.point), 0.1 * std::cos(c.point));
    }
  }
  expect_same_optimum(start, {.max_iterations = 500});
}

// Another camera than the first may start where the first is: it has a pose all the same.
TEST(BlockSolve, MovesACameraThatStartsAtTheIdentity) {
  Calibration start =
      start_of({.lenses = {example_lens("opencv5"), example_lens("opencv5")}, .baseline_m = 0.002}, 0.1, 19);
  start.rig.T_cam_rig[1] = SE3();
  Calibration cal = start;
  ASSERT_TRUE(solve_blocks(cal, {}).usable);
  EXPECT_GT(cal.rig.T_cam_rig[1].t().norm(), 1e-4);
  expect_same_optimum(start, {});
}

TEST(BlockSolve, GivesTheSameBytesForAnyNumberOfThreads) {
  const Calibration start =
      start_of({.lenses = {example_lens("opencv8"), example_lens("kb4")}, .n_frames = 50}, 0.3, 14);
  std::vector<Calibration> results;
  for (int n_threads : {1, 2, 3, 7}) {
    results.push_back(start);
    ASSERT_TRUE(solve_blocks(results.back(), {.n_threads = n_threads}).usable);
  }
  for (const Calibration& other : results) {
    for (std::size_t cam = 0; cam < 2; ++cam) {
      const std::span<const double> a = params(results[0].rig.cameras[cam].lens),
                                    b = params(other.rig.cameras[cam].lens);
      EXPECT_TRUE(std::equal(a.begin(), a.end(), b.begin()));
    }
    EXPECT_EQ(results[0].rig.T_cam_rig, other.rig.T_cam_rig);
    EXPECT_EQ(results[0].T_rig_board, other.T_rig_board);
  }
}

TEST(BlockSolve, SaysWhenACornerDoesNotProjectAtTheStart) {
  Calibration cal = start_of({.lenses = {example_lens("opencv5")}}, 0.3, 15);
  cal.T_rig_board[2] = SE3(cal.T_rig_board[2]->R(), -cal.T_rig_board[2]->t());
  const SolveReport report = solve_blocks(cal, {});
  EXPECT_FALSE(report.usable);
  EXPECT_NE(report.termination.find("domain"), std::string::npos);
}

}  // namespace
}  // namespace plumbline::test
