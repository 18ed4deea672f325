// SPDX-License-Identifier: Apache-2.0
// White box: splined lenses in the block solver. The kernel's sums, for each instruction set that this
// processor has, against the same sums made from the lens' own derivatives, corner by corner; optima against
// Ceres.
#include "refine/spline_view.hpp"

#include <gtest/gtest.h>

#include "plumbline/geometry/so3.hpp"
#include "refine/block_support.hpp"
#include "refine/bow_support.hpp"
#include "refine/kernel_sets.hpp"
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

// The truth with noise, the first lenses replaced by splines, and pushed off.
Calibration start_of(const Simulation& sim, const std::string& spec, double noise_px, int n_splined = 1) {
  Calibration cal = sim.truth;
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
Calibration start_of(const Scene& scene, const std::string& spec, double noise_px, int n_splined = 1) {
  return start_of(simulate(scene), spec, noise_px, n_splined);
}

SolveSpec spec_for(const Calibration& cal) {
  SolveSpec spec;
  spec.held.assign(shared_parameter_names(cal).size(), false);
  hold_cores(cal.rig, spec.held);
  return spec;
}

// One view's sums from project(): over all parameters of the lens, the step of the board in the camera's
// frame, the residual, and the bow.
MatX sums_of(const Lens& lens, const SE3& T, const std::vector<Observation>& list, const Vec2& bow_m) {
  const int n = n_params(lens);
  MatX sums = MatX::Zero(n + 9, n + 9);
  for (const Observation& o : list) {
    Mat23 J_px_p;
    JacLens J_px_k;
    const Vec3 q = T.R() * (o.p_board + Vec3(0, 0, bow_m.dot(o.bow_shape)));
    const auto px = project(lens, q + T.t(), &J_px_p, &J_px_k);
    Eigen::Matrix<double, 2, Eigen::Dynamic> J(2, n + 9);
    J << J_px_k, -J_px_p * skew(q), J_px_p, *px - o.px, J_px_p * T.R().col(2) * o.bow_shape.transpose();
    sums += o.weight * o.weight * J.transpose() * J;
  }
  return sums;
}

constexpr double kUntouched = 12345.0;

// The kernel's sums in the same order; those of control points with each other in the lower triangle.
MatX kernel_sums(const KernelSet& set, const Splined& lens, const SE3& T, const ViewCorners& corners,
                 const Vec2& bow_m) {
  const int n = static_cast<int>(lens.k.size()), n_columns = spline_columns(corners);
  std::vector<int> knots(2 * static_cast<std::size_t>(corners.n));
  EXPECT_TRUE(place_corners(lens, T, corners, bow_m, knots.data()));
  SplinePatch patch(lens, 0);
  patch.add(lens, knots.data(), corners.n);
  std::vector<Segment> segments;
  patch.lay_out(lens, 0, 0, segments);
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> R = T.R();
  const Vec3 t = T.t();
  SplineSums sums;
  sums.clear(lens, 2);
  std::vector<double> products(static_cast<std::size_t>(patch.n_rows * n_columns + kSplineSlack));
  std::fill(products.end() - kSplineSlack, products.end(), kUntouched);
  const Eigen::Map<const MatX> control(products.data(), patch.n_rows, n_columns);
  Gram gram;
  const double cost = set.spline({.at = {lens.k.data(), R.data(), t.data()},
                                  .order = lens.order,
                                  .n_x = lens.n_x,
                                  .n_y = lens.n_y,
                                  .knots_per_unit = lens.knots_per_unit(),
                                  .points = corners.points->data(),
                                  .px = corners.px.data(),
                                  .n = corners.n,
                                  .n_padded = corners.n_padded(),
                                  .first_knots = knots.data(),
                                  .row_of_knots = patch.row_of_knots.data(),
                                  .n_rows = patch.n_rows,
                                  .bow_m = corners.bowed ? bow_m.data() : nullptr,
                                  .loss = 0,
                                  .loss_scale = 1},
                                 {gram.lower, sums.band.data(), products.data()});
  MatX got = MatX::Zero(n + 9, n + 9);
  expand_band(lens, sums.band, 0, got);
  const auto place = [&](int i) { return i < 4 ? i : n + i - 4; };
  for (int i = 0; i < n_columns + 2; ++i)
    for (int j = 0; j <= i; ++j) got(place(i), place(j)) = gram(i, j);
  int row = 0;
  for (const Segment& s : segments) {
    for (int i = s.first; i < s.first + s.n; ++i, ++row) {
      got(i, i % 2) = control(row, 0), got(i, 2 + i % 2) = control(row, 1);
      for (int c = 2; c < n_columns; ++c) got(n + c - 2, i) = control(row, c);
    }
  }
  EXPECT_NEAR(cost, 0.5 * got(n + 6, n + 6), 1e-12 * cost) << set.name;
  for (std::size_t i = products.size() - kSplineSlack; i < products.size(); ++i)
    EXPECT_EQ(products[i], kUntouched) << set.name;
  return got;
}

TEST(SplineKernel, SumsWhatTheLensSays) {
  for (const char* name : kSmall) {
    const Calibration cal = start_of(wide(), name, 0.5);
    Lens lens = cal.rig.cameras[0].lens;
    Rng rng(9);
    params(lens)[1] *= 1.1;  // fx is not fy
    for (int i = 4; i < n_params(lens); ++i) params(lens)[i] += rng.normal(1e-3);
    const int n = n_params(lens);
    for (std::size_t v = 0; v < 4; ++v) {
      const bool bowed = v >= 2;
      const Vec2 bow_m = bowed ? Vec2(3e-3, -2e-3) : Vec2(0, 0);
      std::vector<Observation> list = observations_of(cal, v, false);
      for (Observation& o : list) o.weight = rng.uniform(0.3, 3);
      const SE3 T = *cal.T_rig_board[cal.data.views[v].frame];
      MatX expected = sums_of(lens, T, list, bow_m);
      if (!bowed) expected.bottomRows(2).setZero();
      const VecX scale = expected.diagonal().cwiseMax(1e-6).cwiseSqrt().cwiseInverse();
      for (const KernelSet* set : kernel_sets_here()) {
        const MatX got = kernel_sums(*set, std::get<Splined>(lens), T, view_corners(list, bowed), bow_m);
        const MatX difference = (got - expected).triangularView<Eigen::Lower>();
        EXPECT_LT((scale.asDiagonal() * difference * scale.asDiagonal())
                      .topLeftCorner(n + (bowed ? 9 : 7), n + (bowed ? 9 : 7))
                      .cwiseAbs()
                      .maxCoeff(),
                  1e-12)
            << set->name << " " << name << " view " << v;
      }
    }
  }
}

// The smallest grids, and corners in the outermost cells, at the edge itself and in the middle.
TEST(SplineKernel, ReachesTheEdgesOfItsGrid) {
  for (const auto& [order, n_x, n_y] : {std::tuple(2, 3, 3), {3, 4, 4}, {2, 6, 4}, {3, 5, 7}}) {
    Splined splined(order, n_x, n_y, 120);
    std::fill_n(splined.k.begin(), 2, 300.0);
    Rng rng(4);
    for (std::size_t i = 4; i < splined.k.size(); ++i) splined.k[i] = rng.normal(1e-3);
    const Lens lens = splined;
    const int n = n_params(lens);
    std::vector<Observation> list;
    for (const double x : {-1.0, -0.99, 0.0, 0.7, 1.0}) {
      for (const double y : {-1.0, 0.1, 0.98, 1.0}) {
        const Vec3 ray = ray_of_stereographic(splined.reach().cwiseProduct(Vec2(x, y)) * (1 - 1e-12));
        list.push_back({ray, Vec2(rng.normal(2), rng.normal(2)), rng.uniform(0.5, 2), Vec2(0.3, 0.6)});
      }
    }
    const Vec2 bow_m(0, 0);  // the rays are where they are
    const MatX expected = sums_of(lens, SE3(), list, bow_m);
    const VecX scale = expected.diagonal().cwiseMax(1e-6).cwiseSqrt().cwiseInverse();
    for (const KernelSet* set : kernel_sets_here()) {
      const MatX got = kernel_sums(*set, splined, SE3(), view_corners(list, true), bow_m);
      const MatX difference = (got - expected).triangularView<Eigen::Lower>();
      EXPECT_LT((scale.asDiagonal() * difference * scale.asDiagonal()).cwiseAbs().maxCoeff(), 1e-11)
          << set->name << " order " << order << " " << n_x << "x" << n_y << ", " << n << " parameters";
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

// Frames that only one of two cameras sees, and a camera that nobody sees, splined or beside a splined one.
TEST(BlockSolveSplined, LeavesAloneWhatIsNotSeen) {
  Calibration start = start_of(wide({"kb4"}, 14, 9), kSmall[0], 0.3);
  for (std::size_t v = 0; v < start.data.views.size(); ++v) {
    const View& view = start.data.views[v];
    if (view.frame % 3 != 0 && (view.frame % 3 == 1) == (view.cam == 0)) start.fits[v].clear();
  }
  expect_same_optimum(start, spec_for(start));
  for (const int unseen : {0, 1}) {
    for (const int n_splined : {1, 2}) {
      Calibration cal = start_of(wide({"kb4"}, 12, 9), kSmall[0], 0.3, n_splined);
      if (unseen == 1 && n_splined == 1) std::swap(cal.rig.cameras[0].lens, cal.rig.cameras[1].lens);
      for (std::size_t v = 0; v < cal.data.views.size(); ++v)
        if (cal.data.views[v].cam == unseen) cal.fits[v].clear();
      const std::vector<double> before(params(cal.rig.cameras[static_cast<std::size_t>(unseen)].lens).begin(),
                                       params(cal.rig.cameras[static_cast<std::size_t>(unseen)].lens).end());
      SolveSpec spec = spec_for(cal);
      if (unseen == 0)  // nobody else says where the rig stands
        std::fill_n(spec.held.begin() + offsets_of(cal).pose[1], 6, true);
      expect_same_optimum(cal, spec);
      ASSERT_TRUE(solve_blocks(cal, spec).converged);
      const auto after = params(cal.rig.cameras[static_cast<std::size_t>(unseen)].lens);
      EXPECT_TRUE(std::equal(before.begin(), before.end(), after.begin())) << unseen << n_splined;
    }
  }
}

TEST(BlockSolveSplined, TiesWhatStandsBesideIt) {
  Calibration cal = start_of(wide({"kb4"}, 14, 10), kSmall[0], 0.3);
  SolveSpec spec = spec_for(cal);
  const Offsets offsets = offsets_of(cal);
  for (int i = 0; i < offsets.total; ++i) spec.tied_to.push_back(i);
  spec.tied_to[static_cast<std::size_t>(offsets.lens[1] + 1)] = offsets.lens[1];
  const auto k = params(cal.rig.cameras[1].lens);
  k[1] = k[0];
  Calibration free = cal;
  const SolveReport tied = solve_blocks(cal, spec);
  ASSERT_TRUE(tied.converged) << tied.termination;
  EXPECT_EQ(params(cal.rig.cameras[1].lens)[0], params(cal.rig.cameras[1].lens)[1]);
  // A tie is a prior on the difference as strong as can be: the free optimum is lower, and one with fy held
  // where the tie left it ends at the same place.
  spec.tied_to.clear();
  EXPECT_LT(solve_blocks(free, spec).cost, tied.cost);
  Calibration held = cal;
  spec.held[static_cast<std::size_t>(offsets.lens[1] + 1)] = true;
  spec.held[static_cast<std::size_t>(offsets.lens[1])] = true;
  const SolveReport there = solve_ceres(held, spec);
  EXPECT_NEAR(there.cost, tied.cost, 1e-9 * tied.cost);
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

TEST(BlockSolveSplined, BendsItsBoards) {
  Simulation sim = with_second_board(simulate(wide({"kb4"}, 15, 8)));
  bend(sim, Vec2(2e-3, -1.5e-3));
  for (const int n_splined : {1, 2}) {
    Calibration start =
        start_of(sim, n_splined == 1 ? "splined:9x8:130" : "splined:11x11:150:2", 0.2, n_splined);
    start.bow_m = {Vec2(0, 0), Vec2(0, 0)};
    SolveSpec spec = spec_for(start);
    expect_same_optimum(start, spec);
    spec.priors = {{offsets_of(start).bow[1], 1e-3, 1e-4}};
    expect_same_optimum(start, spec);
    Calibration cal = start;
    spec.priors.clear();
    ASSERT_TRUE(solve_blocks(cal, spec).converged);
    EXPECT_LT((*cal.bow_m[0] - Vec2(2e-3, -1.5e-3)).norm(), 2e-4);
  }
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
