// SPDX-License-Identifier: Apache-2.0
// White box: splined lenses in the block solver. The kernel's sums, for each instruction set that this
// processor has, against the same sums made from the lens' own derivatives, corner by corner; optima against
// Ceres.
#include "refine/spline_view.hpp"

#include <gtest/gtest.h>

#include "plumbline/geometry/so3.hpp"
#include "refine/block_solve.hpp"
#include "refine/kernel_sets.hpp"
#include "refine/refine_support.hpp"
#include "refine/seed.hpp"

namespace plumbline::test {
namespace {

using namespace detail;

constexpr const char* kSmall[] = {"splined:9x8:130", "splined:10x8:130:2"};

Scene wide(std::vector<std::string> others = {}, int n_frames = 15, std::uint64_t seed = 3) {
  Scene scene{.lenses = {lens_like_glass("kb4", {300, 301, 322, 238})},
              .fov_deg = 120,
              .n_frames = n_frames,
              .target = Chessboard{.columns = 10, .rows = 8, .square_m = 0.03},
              .seed = seed};
  for (const std::string& name : others) scene.lenses.push_back(lens_like_glass(name, {300, 302, 318, 241}));
  return scene;
}

// The truth with noise, kb4 replaced by the spline, and pushed off.
Calibration start_of(const Scene& scene, const std::string& spec, double noise_px, int n_splined = 1) {
  Calibration cal = simulate(scene).truth;
  cal.data = with_noise(cal.data, noise_px, 7);
  for (int i = 0; i < n_splined; ++i) {
    Camera& camera = cal.rig.cameras[i];
    camera.lens = sparse_like(camera.lens, spec, camera.size).value();
  }
  Rng rng(5);
  const auto push = [&](SE3& T) {
    Vec6 d;
    for (double& x : d) x = rng.normal(0.003);
    T = box_plus(T, d);
  };
  for (std::size_t i = 1; i < cal.rig.T_cam_rig.size(); ++i) push(cal.rig.T_cam_rig[i]);
  for (auto& T : cal.T_rig_board) push(*T);
  for (const View& view : cal.data.views) cal.fits.emplace_back(view.corners.size());
  cal.view_reason.assign(cal.data.views.size(), "");
  return cal;
}

SolveSpec spec_for(const Calibration& cal) {
  SolveSpec spec;
  spec.held.assign(shared_parameter_names(cal).size(), false);
  hold_cores(cal.rig, spec.held);
  return spec;
}

void expect_same_optimum(const Calibration& start, const SolveSpec& spec) {
  ASSERT_TRUE(block_solver_can(start, spec));
  Calibration blocks = start, ceres = start;
  const SolveReport a = solve_blocks(blocks, spec), b = solve_ceres(ceres, spec);
  ASSERT_TRUE(a.usable && a.converged) << a.termination;
  ASSERT_TRUE(b.usable) << b.termination;
  EXPECT_NEAR(a.cost, b.cost, 1e-9 * b.cost) << a.termination << " / " << b.termination;
}

// One view's sums from project_sparse(): over all parameters of the lens, the step of the board in the
// camera's frame, and the residual.
MatX sums_of(const Lens& lens, const SE3& T, const std::vector<Observation>& list) {
  const int n = n_params(lens);
  MatX sums = MatX::Zero(n + 7, n + 7);
  for (const Observation& o : list) {
    Mat23 J_px_p;
    JacLens J_px_k;
    const Vec3 q = T.R() * o.p_board;
    const auto px = project(lens, q + T.t(), &J_px_p, &J_px_k);
    Eigen::Matrix<double, 2, Eigen::Dynamic> J(2, n + 7);
    J << J_px_k, -J_px_p * skew(q), J_px_p, *px - o.px;
    sums += o.weight * o.weight * J.transpose() * J;
  }
  return sums;
}

TEST(SplineKernel, SumsWhatTheLensSays) {
  for (const char* name : kSmall) {
    const Calibration cal = start_of(wide(), name, 0.5);
    Lens lens = cal.rig.cameras[0].lens;
    const auto& splined = std::get<Splined>(lens);
    Rng rng(9);
    params(lens)[1] *= 1.1;  // fx is not fy
    for (int i = 4; i < n_params(lens); ++i) params(lens)[i] += rng.normal(1e-3);
    const int n = n_params(lens);
    for (std::size_t v = 0; v < 3; ++v) {
      std::vector<Observation> list = observations_of(cal, v, false);
      for (Observation& o : list) o.weight = rng.uniform(0.3, 3);
      const SE3 T = *cal.T_rig_board[cal.data.views[v].frame];
      const ViewCorners corners = view_corners(list);
      const MatX expected = sums_of(lens, T, list);
      const VecX scale = expected.diagonal().cwiseMax(1e-6).cwiseSqrt().cwiseInverse();
      std::vector<int> knots(2 * list.size());
      ASSERT_TRUE(place_corners(splined, T, corners, knots.data()));
      SplinePatch patch(splined, 0);
      patch.add(splined, knots.data(), corners.n);
      std::vector<Segment> segments;
      patch.lay_out(splined, 0, 0, segments);
      const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> R = T.R();
      const Vec3 t = T.t();
      for (const KernelSet* set : kernel_sets_here()) {
        SplineSums sums;
        sums.clear(splined, 2);
        MatX control = MatX::Zero(patch.n_rows, kSplineColumns);
        Gram gram;
        const double cost = set->spline({{splined.k.data(), R.data(), t.data()},
                                         splined.order,
                                         splined.n_x,
                                         splined.n_y,
                                         splined.knots_per_unit(),
                                         corners.points->data(),
                                         corners.px.data(),
                                         corners.n,
                                         corners.n_padded(),
                                         knots.data(),
                                         patch.row_of_knots.data(),
                                         patch.n_rows,
                                         0,
                                         1},
                                        {gram.lower, sums.band.data(), control.data()});
        EXPECT_NEAR(cost, 0.5 * expected(n + 6, n + 6), 1e-12 * expected(n + 6, n + 6)) << set->name;
        MatX got = MatX::Zero(n + 7, n + 7);
        expand_band(splined, sums.band, 0, got);
        const auto place = [&](int i) { return i < 4 ? i : n + i - 4; };
        for (int i = 0; i < kSplineGram; ++i)
          for (int j = 0; j <= i; ++j) got(place(i), place(j)) = gram(i, j);
        int row = 0;
        for (const Segment& s : segments) {
          for (int i = s.first; i < s.first + s.n; ++i, ++row) {
            got(i, i % 2) = control(row, 0), got(i, 2 + i % 2) = control(row, 1);
            for (int c = 2; c < kSplineColumns; ++c) got(n + c - 2, i) = control(row, c);
          }
        }
        const MatX difference = (got - expected).triangularView<Eigen::Lower>();
        EXPECT_LT((scale.asDiagonal() * difference * scale.asDiagonal()).cwiseAbs().maxCoeff(), 1e-12)
            << set->name << " " << name << " view " << v;
      }
    }
  }
}

TEST(SplineKernel, SaysWhenTheSurfaceIsFolded) {
  const Calibration cal = start_of(wide(), kSmall[0], 0.5);
  Calibration folded = cal;
  auto& splined = std::get<Splined>(folded.rig.cameras[0].lens);
  for (int j = 0; j < splined.n_y; ++j) {
    for (int i = 0; i < splined.n_x; ++i)
      splined.k[static_cast<std::size_t>(splined.control_point(i, j))] -= 1.5 * splined.knot(i, j).x();
  }
  const SolveReport report = solve_blocks(folded, spec_for(folded));
  EXPECT_FALSE(report.usable);
  EXPECT_NE(report.termination.find("domain"), std::string::npos) << report.termination;
  Calibration outside = cal;
  outside.T_rig_board[1] = SE3(outside.T_rig_board[1]->R(), -outside.T_rig_board[1]->t());
  EXPECT_FALSE(solve_blocks(outside, spec_for(outside)).usable);
}

TEST(BlockSolveSplined, ReachesCeresOptimum) {
  for (const char* name : kSmall) {
    const Calibration start = start_of(wide(), name, 0.3);
    for (const Loss loss : {Loss::kSquared, Loss::kHuber, Loss::kCauchy}) {
      SolveSpec spec = spec_for(start);
      spec.loss = loss, spec.loss_scale = 0.5;
      expect_same_optimum(start, spec);
    }
  }
}

TEST(BlockSolveSplined, ReachesCeresOptimumWeighedHeldAndWithABoardThatStays) {
  Calibration start = start_of(wide(), kSmall[0], 0.3);
  Rng rng(10);
  for (View& view : start.data.views)
    for (Corner& c : view.corners) c.sigma_px = rng.uniform(0.1, 1);
  SolveSpec spec = spec_for(start);
  spec.use_sigma = true;
  for (int i = 40; i < 60; ++i) spec.held[static_cast<std::size_t>(i)] = true;
  expect_same_optimum(start, spec);
  spec.hold_boards = true;
  expect_same_optimum(start, spec);
}

// The same with its core free, which the regularisation alone determines.
TEST(BlockSolveSplined, ReachesCeresOptimumWithItsCoreFree) {
  const Calibration start = start_of(wide(), kSmall[0], 0.3);
  SolveSpec spec = spec_for(start);
  spec.held.assign(spec.held.size(), false);
  expect_same_optimum(start, spec);
}

TEST(BlockSolveSplined, ReachesCeresOptimumOfARig) {
  expect_same_optimum(start_of(wide({"kb4"}, 12, 4), kSmall[0], 0.3),
                      spec_for(start_of(wide({"kb4"}, 12, 4), kSmall[0], 0.3)));
  const Calibration both = start_of(wide({"kb4", "kb4"}, 12, 5), kSmall[1], 0.3, 2);
  SolveSpec spec = spec_for(both);
  expect_same_optimum(both, spec);
  const int at = offsets_of(both).pose[1];
  spec.priors = {{at + 1, 0.02, 0.001}, {at + 3, -0.09, 0.0005}};
  spec.prior_weight = 0.3;
  expect_same_optimum(both, spec);
}

TEST(BlockSolveSplined, TakesSeveralBoards) {
  Calibration start = start_of(wide({"kb4"}, 18, 6), kSmall[0], 0.3, 2);
  // The board twice: in every third frame a second one, somewhere else, is seen; in every fourth both, so
  // that they hang together.
  start.data.targets.push_back(start.data.targets[0]);
  start.data.targets[1].name = "second";
  start.T_board0_board.push_back(SE3(so3_exp(Vec3(0.1, -0.1, 0.2)), Vec3(0.03, 0.02, 0.01)));
  for (View& view : start.data.views) {
    if (view.frame % 3 != 1 && (view.frame % 4 != 2 || view.cam != 1)) continue;
    view.target = 1;
    for (Corner& c : view.corners) {
      const auto px = predict(start, view, c.point);
      if (px) c.px = *px + Vec2(0.2 * std::sin(c.point), 0.2 * std::cos(c.point));
    }
  }
  expect_same_optimum(start, spec_for(start));
}

// Enough control points for the matrix to be made in panels.
TEST(BlockSolveSplined, GivesTheSameBytesForAnyNumberOfThreads) {
  const Calibration start = start_of(wide({"kb4"}, 40), "splined:16x14:130", 0.3);
  std::vector<Calibration> results;
  for (int n_threads : {1, 2, 3, 7}) {
    SolveSpec spec = spec_for(start);
    spec.n_threads = n_threads;
    results.push_back(start);
    ASSERT_TRUE(solve_blocks(results.back(), spec).converged);
  }
  for (const Calibration& other : results) {
    for (std::size_t cam = 0; cam < 2; ++cam) {
      const std::span<const double> a = params(results[0].rig.cameras[cam].lens),
                                    b = params(other.rig.cameras[cam].lens);
      EXPECT_TRUE(std::equal(a.begin(), a.end(), b.begin()));
    }
    EXPECT_EQ(results[0].T_rig_board, other.T_rig_board);
  }
  expect_same_optimum(start, spec_for(start));
}

}  // namespace
}  // namespace plumbline::test
