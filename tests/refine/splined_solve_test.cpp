// SPDX-License-Identifier: Apache-2.0
// White box: the solve of a splined lens, its regularisation and its seed, against mrcal on the same corners.
#include <ceres/cost_function.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "crosscheck/referee.hpp"
#include "refine/refine_support.hpp"
#include "refine/seed.hpp"
#include "refine/solve.hpp"
#include "refine/sparse_cost.hpp"

namespace plumbline::test {
namespace {

using namespace detail;

Scene wide_scene(int n_frames, std::uint64_t seed = 1) {
  return {.lenses = {lens_like_glass("kb4", {300, 301, 322, 238})},
          .fov_deg = 120,
          .n_frames = n_frames,
          .target = Chessboard{.columns = 10, .rows = 8, .square_m = 0.03},
          .seed = seed};
}

// The truth's poses with a spline in the place of its lens, all corners taking part.
Calibration start_of(const Scene& scene, const std::string& spec, double noise_px) {
  Calibration cal = simulate(scene).truth;
  cal.data = with_noise(cal.data, noise_px, 7);
  for (Camera& camera : cal.rig.cameras) camera.lens = sparse_like(camera.lens, spec, camera.size).value();
  for (const View& view : cal.data.views) cal.fits.emplace_back(view.corners.size());
  cal.view_reason.assign(cal.data.views.size(), "");
  return cal;
}

SolveSpec spec_for(const Rig& rig) {
  SolveSpec spec;
  spec.held.assign(shared_parameter_names(rig).size(), false);
  hold_cores(rig, spec.held);
  return spec;
}

double cost_of(Calibration cal) {
  SolveSpec spec = spec_for(cal.rig);
  spec.max_iterations = 0;
  return solve_ceres(cal, spec).cost;
}

RefereeLens as_mrcals(const Lens& lens) {
  const auto& splined = std::get<Splined>(lens);
  RefereeLens out;
  out.name = fmt::format("LENSMODEL_SPLINED_STEREOGRAPHIC_order={}_Nx={}_Ny={}_fov_x_deg={}", splined.order,
                         splined.n_x, splined.n_y, splined.fov_x_deg);
  EXPECT_TRUE(mrcal_lensmodel_from_name(&out.model, out.name.c_str()));
  out.parameters = splined.k;
  return out;
}

class SplinedSolve : public ::testing::TestWithParam<const char*> {};

// mrcal_optimize with its own regularisation, from the same start.
TEST_P(SplinedSolve, ReachesMrcalsOptimum) {
  const Calibration start = start_of(wide_scene(20), GetParam(), 0.3);
  Calibration ours = start;
  for (auto& T : ours.T_rig_board) T = box_plus(*T, Vec6::Constant(1e-3));
  const SolveReport report = solve_ceres(ours, spec_for(ours.rig));
  ASSERT_TRUE(report.usable && report.converged) << report.termination;
  auto problem = make_problem(start, *referee_lattice(start.data.targets[0]),
                              {as_mrcals(start.rig.cameras[0].lens)}, false);
  ASSERT_TRUE(optimise(problem, {.core = false, .distortion = true, .regularise = true, .max_rounds = 30}));
  Calibration theirs = start;
  std::get<Splined>(theirs.rig.cameras[0].lens).k = problem.intrinsics[0];
  for (std::size_t f = 0; f < problem.frames.size(); ++f)
    theirs.T_rig_board[problem.frames[f]] = problem.T_ref_board[f];
  const double their_cost = cost_of(theirs);
  RecordProperty("cost_above_ours", fmt::format("{:.3e}", their_cost / report.cost - 1));
  EXPECT_GE(their_cost, report.cost * (1 - 1e-12));
  EXPECT_LT(their_cost, report.cost * (1 + 1e-6));
  double worst_px = 0;
  for (const View& view : start.data.views) {
    for (const Corner& c : view.corners) {
      const Vec3 p = *ours.T_rig_board[view.frame] * start.data.targets[view.target].points[c.point];
      const Vec3 q = *theirs.T_rig_board[view.frame] * start.data.targets[view.target].points[c.point];
      worst_px = std::max(
          worst_px, (*project(ours.rig.cameras[0].lens, p) - *project(theirs.rig.cameras[0].lens, q)).norm());
    }
  }
  RecordProperty("worst_px", fmt::format("{:.3e}", worst_px));
  EXPECT_LT(worst_px, 1e-3);
}

INSTANTIATE_TEST_SUITE_P(Shapes, SplinedSolve,
                         ::testing::Values("splined:12x10:130", "splined:10x9:130:2", "splined:11x9:130"));

TEST(SparseCost, JacobiansAgreeWithDifferences) {
  const Calibration cal = start_of(wide_scene(1), "splined:9x8:130", 0.5);
  const Lens& lens = cal.rig.cameras[0].lens;
  const int n_lens = n_params(lens);
  const SE3 T_cam_rig(so3_exp(Vec3(0.01, -0.02, 0.03)), Vec3(0.001, 0.002, -0.003));
  std::vector<Observation> list = observations_of(cal, 0, false);
  list.resize(6);
  list[3].px += Vec2(20, 10);
  list[4].weight = 0.5;
  const auto n = static_cast<Eigen::Index>(2 * list.size());
  for (const Loss loss : {Loss::kSquared, Loss::kHuber, Loss::kCauchy}) {
    const auto cost = make_sparse_cost(std::make_shared<Lens>(lens), list, loss, 1.5, true);
    const SE3 T_further(so3_exp(Vec3(0.01, 0.02, 0)), Vec3(0.001, 0, 0.002));
    const auto residuals = [&](const Lens& l, const SE3& T_cam, const SE3& T_board, double** J,
                               const SE3& T_board0_board) {
      VecX r(n);
      const double* k = params(l).data();
      const double* blocks[] = {k, k + 4, T_cam.qt.data(), T_board.qt.data(), T_board0_board.qt.data()};
      EXPECT_TRUE(cost->Evaluate(blocks, r.data(), J));
      return r;
    };
    using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Rows J_core(n, 4), J_others(n, n_lens - 4), J_cam(n, 7), J_board(n, 7), J_further(n, 7);
    double* J[] = {J_core.data(), J_others.data(), J_cam.data(), J_board.data(), J_further.data()};
    const SE3 T_board = *cal.T_rig_board[0];
    residuals(lens, T_cam_rig, T_board, J, T_further);
    const double h = 1e-6;  // pixels of some hundreds: differences are good to 1e-7 of a column
    const auto check = [&](const VecX& plus, const VecX& minus, const VecX& column, const char* what, int i) {
      const VecX d = (plus - minus) / (2 * h);
      EXPECT_LT((d - column).norm(), 1e-5 * (1 + d.norm())) << what << " " << i;
    };
    for (int i = 0; i < n_lens; ++i) {
      Lens up = lens, down = lens;
      params(up)[i] += h, params(down)[i] -= h;
      check(residuals(up, T_cam_rig, T_board, nullptr, T_further),
            residuals(down, T_cam_rig, T_board, nullptr, T_further),
            i < 4 ? VecX(J_core.col(i)) : VecX(J_others.col(i - 4)), "lens", i);
    }
    for (int i = 0; i < 6; ++i) {
      const Vec6 s = h * Vec6::Unit(i);
      check(residuals(lens, box_plus(T_cam_rig, s), T_board, nullptr, T_further),
            residuals(lens, box_plus(T_cam_rig, -s), T_board, nullptr, T_further), J_cam.col(i), "camera", i);
      check(residuals(lens, T_cam_rig, box_plus(T_board, s), nullptr, T_further),
            residuals(lens, T_cam_rig, box_plus(T_board, -s), nullptr, T_further), J_board.col(i), "board",
            i);
      check(residuals(lens, T_cam_rig, T_board, nullptr, box_plus(T_further, s)),
            residuals(lens, T_cam_rig, T_board, nullptr, box_plus(T_further, -s)), J_further.col(i),
            "further", i);
    }
  }
}

TEST(SparseLike, ProjectsAsTheLensThatItIsLike) {
  for (const char* name : {"kb4", "opencv8", "eucm"}) {
    const double f = is_central_perspective(make_lens(name, {640, 480}, 1).value()) ? 550 : 330;
    const Lens like = lens_like_glass(name, {f, f + 1, 322, 238});
    const Lens lens = sparse_like(like, "splined", {640, 480}).value();
    double worst = 0;
    for (int y = 0; y <= 480; y += 20) {
      for (int x = 0; x <= 640; x += 20) {
        const auto ray = unproject(like, Vec2(x, y));
        if (ray) worst = std::max(worst, (project(lens, *ray).value() - Vec2(x, y)).norm());
      }
    }
    EXPECT_LT(worst, 0.02) << name << " " << lens_spec(lens);  // what a cubic spline of 16 cells leaves
  }
}

// Median error of the true pixels of fresh views under a calibrated lens, their poses fitted.
double typical_fresh_error_px(const Calibration& cal, const Scene& scene) {
  Calibration fresh = simulate(scene).truth;
  fresh.rig = cal.rig;
  fresh.fits.clear();
  for (const View& view : fresh.data.views) fresh.fits.emplace_back(view.corners.size());
  fresh.view_reason.assign(fresh.data.views.size(), "");
  SolveSpec spec;
  spec.loss = Loss::kCauchy;
  spec.loss_scale = 0.1;
  spec.held.assign(shared_parameter_names(fresh.rig).size(), true);
  bring_back(fresh);
  EXPECT_TRUE(solve_ceres(fresh, spec).usable);
  bring_back(fresh);
  std::vector<double> errors;
  for (const auto& fits : fresh.fits)
    for (const CornerFit& fit : fits) errors.push_back(fit.outlier ? 1e9 : fit.residual_px.norm());
  std::nth_element(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2),
                   errors.end());
  return errors[errors.size() / 2];
}

TEST(CalibrateSplined, FromCornersAlone) {
  struct Try {
    Scene scene;
    const char* lens;
  };
  Scene narrow{.lenses = {example_lens("opencv5")}, .n_frames = 25, .seed = 2};
  for (const auto& [scene, name] :
       {Try{wide_scene(25, 3), "splined:9x8:140"}, Try{narrow, "splined:8x7:75"}}) {
    const Simulation sim = simulate(scene);
    RefineOptions options;
    options.lenses = {name};
    const auto cal = calibrate(with_noise(sim.truth.data, 0.2, 5), options);
    ASSERT_TRUE(cal) << cal.error().text();
    EXPECT_TRUE(cal->stats.converged) << cal->stats.termination;
    EXPECT_LT(cal->stats.rms_px, 0.2 * std::sqrt(2.0) * 1.02);
    EXPECT_GT(cal->stats.rms_px, 0.2 * std::sqrt(2.0) * 0.8);
    EXPECT_LT(cal->stats.n_outliers, 5);
    EXPECT_FALSE(cal->covariance);
    // Fresh views reach where no corner was, and a spline says nothing of that: the middle one tells.
    Scene other = scene;
    other.seed = 77, other.n_frames = 12;
    EXPECT_LT(typical_fresh_error_px(*cal, other), 0.06) << name;
  }
}

TEST(CalibrateSplined, InARigBesideAnotherLens) {
  Scene scene{.lenses = {example_lens("opencv5"), example_lens("opencv5")}, .n_frames = 15, .seed = 4};
  const Simulation sim = simulate(scene);
  RefineOptions options;
  options.lenses = {"opencv5", "splined:10x8:75"};
  const auto cal = calibrate(with_noise(sim.truth.data, 0.1, 5), options);
  ASSERT_TRUE(cal) << cal.error().text();
  EXPECT_LT(cal->stats.rms_px, 0.15);
  EXPECT_LT(box_minus(cal->rig.T_cam_rig[1], sim.truth.rig.T_cam_rig[1]).norm(),
            5e-3);  // a turned spline is another one
  // The same corners give the same bytes.
  const auto again = refine(*cal, options);
  const auto twice = refine(*cal, options);
  ASSERT_TRUE(again && twice);
  EXPECT_EQ(std::get<Splined>(again->rig.cameras[1].lens).k, std::get<Splined>(twice->rig.cameras[1].lens).k);
}

// The spline ends inside no picture, but its grid is not the picture's: nothing is to be said of folds there.
TEST(CalibrateSplined, ANarrowViewWithSomePlainCamera) {
  const Simulation sim = simulate({.lenses = {example_lens("opencv5"), example_lens("opencv5")}, .seed = 6});
  RefineOptions options;
  options.lenses = {"splined:10x8:90", "opencv5"};
  const auto cal = calibrate(with_noise(sim.truth.data, 0.1, 2), options);
  ASSERT_TRUE(cal) << cal.error().text();
  EXPECT_LT(cal->stats.rms_xy_px, 0.12);
  options.priors = {{"cam0 fx", 500, 5}};
  const auto refused = calibrate(sim.truth.data, options);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kUnsupported);
}

// A prior of the rig weighs by the corners' noise, which a spline's control points must not hide.
TEST(CalibrateSplined, WithPriorsAndTiesOfTheRigBesideIt) {
  const Simulation sim =
      simulate({.lenses = {example_lens("opencv5"), example_lens("opencv5")}, .n_frames = 15, .seed = 6});
  RefineOptions options;
  options.lenses = {"splined:10x8:90", "opencv5"};
  options.priors = {{"cam1 fx", 540, 0.5}};
  options.ties = {"cam1 fx=cam1 fy"};
  const Dataset data = with_noise(sim.truth.data, 0.1, 2);
  const auto cal = calibrate(data, options);
  ASSERT_TRUE(cal) << cal.error().text();
  const auto k = params(cal->rig.cameras[1].lens);
  EXPECT_EQ(k[0], k[1]);
  options.priors.clear();
  const auto without = calibrate(data, options);
  ASSERT_TRUE(without) << without.error().text();
  const double free = params(without->rig.cameras[1].lens)[0];
  EXPECT_GT(std::abs(free - 540), 3);
  EXPECT_GT(std::abs(k[0] - free), 0.02) << "the prior must be felt";
  EXPECT_LT(std::abs(k[0] - free), std::abs(540 - free)) << "and not rule alone";
  options.solver = Solver::kCeres;
  const auto refused = calibrate(data, options);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kUnsupported);
  EXPECT_THAT(refused.error().text(), testing::HasSubstr("block solver"));
}

TEST(CalibrateSplined, HoldsTheCore) {
  Calibration start = start_of(wide_scene(8), "splined:9x8:130", 0.2);
  const auto refined = refine(start, {});
  ASSERT_TRUE(refined) << refined.error().text();
  for (std::size_t i = 0; i < 4; ++i)
    EXPECT_EQ(params(refined->rig.cameras[0].lens)[i], params(start.rig.cameras[0].lens)[i]);
}

}  // namespace
}  // namespace plumbline::test
