// SPDX-License-Identifier: Apache-2.0
// White box: bows and radial guards in the block solver, against Ceres on the same problem.
#include "refine/block_extras.hpp"

#include <gtest/gtest.h>

#include "refine/block_support.hpp"
#include "refine/bow_support.hpp"
#include "refine/radial_guard.hpp"

namespace plumbline::test {
namespace {

using namespace detail;

const Vec2 kBow(2e-3, -1.2e-3);

// Of one camera and a bowed board, or of two cameras and two boards the first of which is taken as flat.
// Bows start at zero.
Calibration bowed_start(const Lens& lens, bool two, double noise_px, std::uint64_t seed, int n_frames = 12) {
  Scene scene{.lenses = {lens}, .n_frames = n_frames, .seed = seed};
  if (two) scene.lenses.push_back(example_lens("kb4", 600));
  Simulation sim = simulate(scene);
  if (two) sim = with_second_board(std::move(sim));
  bend(sim, kBow);
  Calibration start = start_of(sim, noise_px, seed);
  start.bow_m.assign(start.data.targets.size(), std::nullopt);
  start.bow_m.back() = Vec2(0, 0);
  return start;
}

// Both solvers at one optimum: the same cost, and parameters within a thousandth of their sigma. (A cost that
// is good to 1e-12 of itself, of some thousand residuals, leaves some 1e-4 of a sigma open.)
void expect_same(const Calibration& start, const SolveSpec& spec) {
  Calibration blocks = start, ceres = start;
  const SolveReport a = solve_blocks(blocks, spec), b = solve_ceres(ceres, spec);
  ASSERT_TRUE(a.usable && a.converged) << a.termination;
  ASSERT_TRUE(b.usable) << b.termination;
  EXPECT_NEAR(a.cost, b.cost, 1e-9 * b.cost) << a.termination << " / " << b.termination;
  evaluate(ceres);
  const SharedCovariance covariance = shared_covariance(ceres, spec);
  const VecX x = shared_values(blocks), y = shared_values(ceres);
  const std::vector<std::string> names = shared_parameter_names(ceres);
  for (int i = 0; i < x.size(); ++i) {
    const double sigma = std::sqrt(covariance.variance * covariance.unit_covariance(i, i));
    EXPECT_NEAR(x[i], y[i], 1e-3 * sigma + 1e-12) << names[i];
  }
}

TEST(BlockBow, ReachesCeresOptimumUnderEachLoss) {
  for (const Loss loss : {Loss::kSquared, Loss::kHuber, Loss::kCauchy}) {
    const SolveSpec spec{.loss = loss, .loss_scale = 0.3, .max_iterations = 500};
    for (const bool two : {false, true}) expect_same(bowed_start(example_lens("opencv5"), two, 0.2, 3), spec);
  }
}

TEST(BlockBow, ReachesCeresOptimumWithHoldsTiesAndPriors) {
  const Calibration start = bowed_start(example_lens("opencv5"), true, 0.2, 4);
  const Offsets offsets = offsets_of(start);
  ASSERT_TRUE(block_solver_can(start, {}));
  const int bow = offsets.bow[1], n = offsets.total;
  SolveSpec held;
  held.held.assign(static_cast<std::size_t>(n), false);
  held.held[bow + 1] = held.held[1] = true;
  Calibration cal = start;
  cal.bow_m[1]->y() = 5e-4;
  ASSERT_TRUE(solve_blocks(cal, held).converged);
  EXPECT_EQ(cal.bow_m[1]->y(), 5e-4);
  EXPECT_FALSE(cal.bow_m[0].has_value());
  EXPECT_GT(cal.bow_m[1]->x(), 1e-3);
  expect_same(start, held);

  SolveSpec tied;
  for (int i = 0; i < n; ++i) tied.tied_to.push_back(i);
  tied.tied_to[bow + 1] = bow;
  tied.tied_to[1] = 0;
  Calibration square = start;
  const auto k = params(square.rig.cameras[0].lens);
  k[1] = k[0];
  cal = square;
  ASSERT_TRUE(solve_blocks(cal, tied).converged);
  EXPECT_EQ(cal.bow_m[1]->x(), cal.bow_m[1]->y());
  expect_same(square, tied);

  SolveSpec prior;
  prior.priors = {{bow, 1e-3, 1e-5}, {bow + 1, -1e-3, 1e-4}, {0, 555, 1}};
  prior.prior_weight = 0.2;
  expect_same(start, prior);
}

TEST(BlockBow, ComesBackWithoutNoise) {
  for (const bool two : {false, true}) {
    Calibration cal = bowed_start(example_lens("opencv5"), two, 0.0, 5);
    if (two) cal.bow_m[0] = Vec2(0, 0);
    ASSERT_TRUE(solve(cal, {}).usable);
    for (const auto& bow : cal.bow_m) EXPECT_LT((*bow - kBow).norm(), 1e-9);
  }
}

// All that a block solver's equations say of shared parameters, a second time: where there is no residual,
// J'J is the derivative of J'r.
TEST(BlockBow, NormalMatrixIsTheDerivativeOfTheGradient) {
  for (const bool two : {false, true}) {
    Calibration cal = bowed_start(example_lens("opencv5"), two, 0.0, 6);
    cal.bow_m[0] = Vec2(0, 0);
    ASSERT_TRUE(solve_ceres(cal, {}).usable);
    const SolveSpec spec;
    const BlockProblem problem = block_problem(cal, spec);
    BlockState state;
    for (const Camera& camera : cal.rig.cameras) state.lenses.push_back(camera.lens);
    state.T_cam_rig = cal.rig.T_cam_rig;
    state.T_board0_board = cal.T_board0_board;
    for (const auto& bow : cal.bow_m) state.bow_m.push_back(bow.value_or(Vec2(0, 0)));
    for (const BlockFrame& frame : problem.frames) state.T_rig_board.push_back(*cal.T_rig_board[frame.frame]);
    BlockNormal normal, up, down;
    ASSERT_TRUE(make_normal(problem, state, normal));
    const int last = two ? 1 : 0;
    for (int b = 0; b < 2; ++b) {
      const double h = 1e-6;
      BlockState moved = state;
      moved.bow_m[last][b] += h;
      ASSERT_TRUE(make_normal(problem, moved, up));
      const BlockVector mixed_up = *mixed_gradient(problem, state, moved);
      moved.bow_m[last][b] -= 2 * h;
      ASSERT_TRUE(make_normal(problem, moved, down));
      const BlockVector mixed_down = *mixed_gradient(problem, state, moved);
      const std::size_t n_frames = problem.frames.size();
      BlockVector v{VecX::Unit(problem.offsets.total, problem.offsets.bow[last] + b),
                    std::vector<Vec6>(n_frames, Vec6::Zero())};
      const BlockVector column = times(problem, normal, v);
      // h^2 of a function that bends over some metres, and rounding of 1e-12 px over h.
      const VecX slope = (up.g_s - down.g_s) / (2 * h);
      EXPECT_LT((slope - column.shared).norm(), 1e-5 * column.shared.norm());
      EXPECT_LT(((mixed_up.shared - mixed_down.shared) / (2 * h) - column.shared).norm(),
                1e-5 * column.shared.norm());
      for (int i = 0; i < problem.offsets.total; ++i)
        EXPECT_NEAR(slope[i], column.shared[i], 1e-4 * std::abs(column.shared[i]) + 1e-7 * slope.norm()) << i;
      for (std::size_t f = 0; f < n_frames; ++f) {
        EXPECT_LT(((up.g_f[f] - down.g_f[f]) / (2 * h) - column.boards[f]).norm(),
                  1e-5 * column.boards[f].norm());
        EXPECT_LT(((mixed_up.boards[f] - mixed_down.boards[f]) / (2 * h) - column.boards[f]).norm(),
                  1e-5 * column.boards[f].norm());
      }
    }
  }
}

// A guard from inside the corners outwards.
RadialGuard guard_with(int cam, double least_slope_px) {
  RadialGuard guard{cam, 0.35, {}, least_slope_px};
  for (int i = 0; i < kGuardDirections; ++i) guard.to[i] = 0.8 + 0.02 * i;
  return guard;
}

// One that asks for `share` of the least slope that a camera's lens has there.
RadialGuard guard_on(const Calibration& cal, int cam, double share) {
  RadialGuard guard = guard_with(cam, 1e4);
  const VecX r = guard_rows(cal.rig.cameras[cam].lens, guard).r;
  const int n_steps = static_cast<int>(r.size()) / kGuardDirections;
  double least = 1e4;
  for (int i = 0; i < kGuardDirections; ++i) {
    const double step = (guard.to[i] - guard.from) / n_steps;
    least = std::min(least, 1e4 - 0.01 * r.segment(i * n_steps, n_steps).maxCoeff() / step);
  }
  guard.least_slope_px = share * least;
  return guard;
}

// Corners near the middle, whose lens is open at the rim.
Calibration central_start(const std::vector<Lens>& lenses, std::uint64_t seed) {
  Simulation sim =
      simulate({.lenses = lenses, .fov_deg = 60, .n_frames = 20, .baseline_m = 0.03, .seed = seed});
  for (View& view : sim.truth.data.views)
    std::erase_if(view.corners, [](const Corner& c) { return (c.px - Vec2(320, 240)).norm() > 170; });
  std::erase_if(sim.truth.data.views, [](const View& view) { return view.corners.size() < 12; });
  return start_of(sim, 0.3, seed);
}

bool rises(const Calibration& cal, const RadialGuard& guard) {
  return guard_rows(cal.rig.cameras[guard.cam].lens, guard).r.maxCoeff() < 1;  // gives way by 0.01 px
}

// Where many rows come and go, Ceres often stalls on its way. It must not end lower, and started at ours it
// must find nothing lower. True when both end at one cost.
bool confirmed(const Calibration& start, SolveSpec spec) {
  Calibration blocks = start, ceres = start;
  const SolveReport a = solve_blocks(blocks, spec), b = solve_ceres(ceres, spec);
  EXPECT_TRUE(a.usable && a.converged) << a.termination;
  EXPECT_LE(a.cost, b.cost * (1 + 1e-9)) << b.termination;
  EXPECT_GE(solve_ceres(blocks, spec).cost, a.cost * (1 - 1e-9));
  return std::abs(a.cost - b.cost) < 1e-9 * b.cost;
}

TEST(BlockGuard, ReachesCeresOptimumWhereTheFreeLensFolds) {
  int n_folded = 0, n_same = 0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const Calibration start = central_start({example_lens("opencv5")}, seed);
    Calibration free = start, held = start;
    const RadialGuard guard = guard_with(0, 0.05 * 550);
    ASSERT_TRUE(solve(free, {}).usable);
    ASSERT_TRUE(solve(held, {.guards = {guard}}).usable);
    EXPECT_TRUE(rises(held, guard)) << seed;
    n_folded += !rises(free, guard);
    n_same += confirmed(start, {.guards = {guard}});
  }
  EXPECT_GE(n_folded, 4);
  EXPECT_GE(n_same, 6);
}

// Of both cameras of a rig, and of every lens: a little steeper than the corners say.
TEST(BlockGuard, ReachesCeresOptimumOfEveryLens) {
  int n = 0, n_same = 0;
  for (const std::string_view name : fixed_lens_names()) {
    const Lens lens = example_lens(name);
    if (n_params(lens) >= 12) continue;  // whose valleys Ceres does not walk to their ends
    SCOPED_TRACE(name);
    const Calibration start = start_of({.lenses = {example_lens("opencv4"), lens}, .n_frames = 8}, 0.1, 7);
    Calibration free = start;
    ASSERT_TRUE(solve(free, {}).usable);
    SolveSpec spec{.max_iterations = 500};
    spec.guards = {guard_on(free, 0, 1.002), guard_on(free, 1, 1.005)};
    ASSERT_FALSE(rises(free, spec.guards[1]));
    n_same += confirmed(free, spec);
    ++n;
  }
  EXPECT_GE(2 * n_same, n);
}

TEST(BlockGuard, StandsBesideTiesPriorsAndBows) {
  Calibration start = bowed_start(example_lens("opencv5"), true, 0.2, 8);
  SolveSpec spec{.max_iterations = 500};
  spec.guards = {guard_with(0, 550)};
  spec.priors = {{0, 555, 1}, {5, 0.0, 0.01}};
  expect_same(start, spec);
  for (int i = 0; i < offsets_of(start).total; ++i) spec.tied_to.push_back(i);
  spec.tied_to[1] = 0;
  const auto k = params(start.rig.cameras[0].lens);
  k[1] = k[0];
  expect_same(start, spec);
}

TEST(BlockGuard, ChangesNothingWhereTheLensRisesAnyway) {
  const Calibration start = start_of({.lenses = {example_lens("opencv5")}}, 0.2, 9);
  Calibration free = start, guarded = start;
  const SolveReport a = solve_blocks(free, {});
  const RadialGuard guard = guard_with(0, 0.05 * 550);
  ASSERT_EQ(guard_rows(free.rig.cameras[0].lens, guard).r.cwiseMax(0).norm(), 0);
  const SolveReport b = solve_blocks(guarded, {.guards = {guard}});
  EXPECT_NEAR(a.cost, b.cost, 1e-12 * a.cost);
  expect_same(start, {.guards = {guard}});
}

// Of a camera without views: both solvers leave it out, tied or not.
TEST(BlockGuard, LeavesUnseenCamerasAlone) {
  Calibration start = start_of({.lenses = {example_lens("opencv5"), example_lens("opencv5")}}, 0.2, 10);
  for (std::size_t v = 0; v < start.data.views.size(); ++v) {
    if (start.data.views[v].cam == 1) start.fits[v].clear();
  }
  SolveSpec spec;
  spec.guards = {guard_with(1, 1100)};
  Calibration cal = start;
  ASSERT_TRUE(solve_blocks(cal, spec).converged);
  const auto before = params(start.rig.cameras[1].lens), after = params(cal.rig.cameras[1].lens);
  EXPECT_TRUE(std::equal(before.begin(), before.end(), after.begin()));
  expect_same_optimum(start, spec);
}

// The equations of guards, a second time: the slope of the cost, and J'r of two states at one.
TEST(BlockGuard, GradientIsTheSlopeOfTheCost) {
  const Calibration cal = start_of({.lenses = {example_lens("opencv4"), example_lens("opencv5")}}, 0.2, 11);
  SolveSpec spec;
  spec.guards = {guard_with(1, 600)};
  const BlockProblem problem = block_problem(cal, spec);
  BlockState state{{cal.rig.cameras[0].lens, cal.rig.cameras[1].lens}, {}, {}, {}, {}};
  const int n = problem.offsets.total, at = problem.offsets.lens[1];
  const auto at_state = [&](const BlockState& s) {
    BlockNormal normal;
    normal.A_ss.setZero(n, n);
    normal.g_s.setZero(n);
    add_extras(problem, s, normal);
    return normal;
  };
  const BlockNormal normal = at_state(state);
  ASSERT_GT(normal.cost, 0);
  BlockState ahead = state;
  VecX mixed = VecX::Zero(n), d = VecX::Zero(n);
  add_mixed_extras(problem, state, state, mixed);
  EXPECT_LT((mixed - normal.g_s).norm(), 1e-12 * mixed.norm());
  for (int i = 0; i < n; ++i) {
    if (i < at || i >= at + n_params(state.lenses[1])) {
      EXPECT_EQ(normal.g_s[i], 0);
      continue;
    }
    const auto p = static_cast<std::size_t>(i - at);
    const double h = 1e-6 * std::max(1.0, params(state.lenses[1])[p]);
    BlockState up = state, down = state;
    params(up.lenses[1])[p] += h;
    params(down.lenses[1])[p] -= h;
    // Rounding of the cost (1e-16 of it) over h, and curvature (h^2).
    EXPECT_NEAR((at_state(up).cost - at_state(down).cost) / (2 * h), normal.g_s[i],
                1e-6 * std::abs(normal.g_s[i]) + 1e-8 * normal.cost);
    d[i] = 1e-3 * h;
    params(ahead.lenses[1])[p] += d[i];
  }
  // Along a step so small that no row comes or goes, J'(r + J d).
  VecX moved = VecX::Zero(n);
  add_mixed_extras(problem, state, ahead, moved);
  const MatX A = normal.A_ss.selfadjointView<Eigen::Lower>();
  EXPECT_LT((moved - mixed - A * d).norm(), 1e-4 * (A * d).norm());
}

// By steps of a thousandth along a direction in which rows come into force and others leave.
TEST(BlockGuard, LengthIsTheMinimumOfTheModel) {
  const Calibration cal = start_of({.lenses = {example_lens("opencv5")}}, 0.2, 13);
  SolveSpec spec;
  spec.guards = {guard_with(0, 500)};
  const BlockProblem problem = block_problem(cal, spec);
  const BlockState state{{cal.rig.cameras[0].lens}, {}, {}, {}, {}};
  const GuardRows rows = guard_rows(state.lenses[0], spec.guards[0]);
  int n_short = 0;
  for (const auto& [turn, curvature] : {std::pair(-0.1, 1e4), {-0.1, 1e7}, {0.1, 1e5}, {-0.3, 1e6}}) {
    const BlockVector step{turn * VecX::Unit(9, 4) - 0.4 * turn * VecX::Unit(9, 5), {}};
    const VecX d = rows.J * step.shared;
    const double slope = -0.7 * curvature;
    const auto model = [&](double t) {
      double sum = t * slope + 0.5 * t * t * curvature;
      for (Eigen::Index i = 0; i < d.size(); ++i) {
        const double r = rows.r[i], x = std::max(0.0, r + t * d[i]);
        sum += 0.5 * (r > 0 ? x * x - (r + t * d[i]) * (r + t * d[i]) : x * x);
      }
      return sum;
    };
    double least = 0;
    for (int i = 1; i <= 1000; ++i) least = std::min(least, model(1e-3 * i));
    const StepLength to = guarded_length(problem, state, step, slope, curvature);
    EXPECT_NEAR(to.gain, -model(to.length), 1e-9 * std::abs(to.gain) + 1e-9);
    EXPECT_LE(model(to.length), least + 1e-9 * std::abs(least));
    n_short += to.length < 0.6;
  }
  EXPECT_GE(n_short, 1);
}

TEST(BlockExtras, GiveTheSameBytesForAnyNumberOfThreads) {
  Calibration start = bowed_start(example_lens("opencv5"), true, 0.3, 12, 40);
  start.bow_m[0] = Vec2(0, 0);
  std::vector<Calibration> results;
  for (int n_threads : {1, 2, 3, 7}) {
    results.push_back(start);
    ASSERT_TRUE(
        solve_blocks(results.back(), {.guards = {guard_with(0, 550)}, .n_threads = n_threads}).usable);
  }
  for (const Calibration& other : results) {
    EXPECT_EQ(shared_values(results[0]), shared_values(other));
    EXPECT_EQ(results[0].T_rig_board, other.T_rig_board);
  }
}

}  // namespace
}  // namespace plumbline::test
