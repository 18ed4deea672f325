// SPDX-License-Identifier: Apache-2.0
#include "refine/solve.hpp"

#include <ceres/cost_function.h>
#include <ceres/manifold.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "plumbline/rig/motion.hpp"
#include "refine/block_solve.hpp"
#include "refine/moving_solve.hpp"
#include "refine/quiet_log.hpp"
#include "refine/radial_guard.hpp"
#include "refine/reprojection_cost.hpp"
#include "refine/shared_block.hpp"
#include "refine/sparse_cost.hpp"

namespace plumbline::detail {

namespace {

bool is_held(const SolveSpec& spec, int i) { return !spec.held.empty() && spec.held[i]; }

void hold_block(ceres::Problem& problem, double* block, int n, int offset, const SolveSpec& spec) {
  std::vector<int> held;
  for (int i = 0; i < n; ++i) {
    if (is_held(spec, offset + i)) held.push_back(i);
  }
  if (static_cast<int>(held.size()) == n)
    problem.SetParameterBlockConstant(block);
  else if (!held.empty())
    problem.SetManifold(block, new ceres::SubsetManifold(n, held));
}

// A lens with sparse derivatives has its core in a block of its own.
void hold_lens(ceres::Problem& problem, const Lens& lens, double* k, int offset, const SolveSpec& spec) {
  const int n = n_params(lens), n_first = is_sparse(lens) ? 4 : n;
  hold_block(problem, k, n_first, offset, spec);
  if (n_first < n) hold_block(problem, k + n_first, n - n_first, offset + n_first, spec);
}

void hold_pose(ceres::Problem& problem, double* block, int offset, const SolveSpec& spec) {
  std::array<bool, 6> held{};
  for (int i = 0; i < 6; ++i) held[i] = is_held(spec, offset + i);
  if (std::all_of(held.begin(), held.end(), [](bool h) { return h; }))
    problem.SetParameterBlockConstant(block);
  else
    problem.SetManifold(block, make_pose_manifold(held).release());
}

ceres::Solver::Options solver_options(const SolveSpec& spec) {
  ceres::Solver::Options options;
  options.max_num_iterations = spec.max_iterations;
  // Tight: the optimum must agree with other solvers to far below 1e-4 px, and Ceres' default (1e-6) stops up
  // to 0.02 px from it.
  options.function_tolerance = spec.tight ? 1e-14 : 1e-7;
  options.parameter_tolerance = spec.tight ? 1e-12 : 1e-8;
  options.gradient_tolerance = spec.tight ? 1e-12 : 1e-10;
  options.num_threads = 1;  // more would add in another order and give other bytes
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_consecutive_invalid_steps =
      30;  // steps out of the lens' domain are invalid, and shrink the region
  options.logging_type = ceres::SILENT;
  options.minimizer_progress_to_stdout = false;
  return options;
}

bool all_finite(const Calibration& cal) {
  const auto finite = [](std::span<const double> x) {
    return std::all_of(x.begin(), x.end(), [](double v) { return std::isfinite(v); });
  };
  for (const Camera& camera : cal.rig.cameras) {
    if (!finite(params(camera.lens)) || !(params(camera.lens)[0] > 0) || !(params(camera.lens)[1] > 0))
      return false;
  }
  for (const SE3& T : cal.rig.T_cam_rig) {
    if (!finite(T.qt)) return false;
  }
  for (const SE3& T : cal.T_board0_board) {
    if (!finite(T.qt)) return false;
  }
  for (const auto& bow : cal.bow_m) {
    if (bow && !bow->allFinite()) return false;
  }
  return true;
}

std::string one_line(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

// All parameter blocks in one array, in a fixed order. Ceres orders the blocks of an elimination group by
// address, and the order decides how sums round: blocks scattered over the heap would give other bytes from
// run to run.
class Blocks {
 public:
  explicit Blocks(const Calibration& cal) {
    for (const Camera& camera : cal.rig.cameras) add(lens_, params(camera.lens));
    for (const SE3& T : cal.rig.T_cam_rig) add(T_cam_rig_, T.qt);
    for (const SE3& T : cal.T_board0_board) add(T_board0_board_, T.qt);
    for (const auto& bow : cal.bow_m) {
      const Vec2 b = bow.value_or(Vec2(0, 0));
      add(bow_, {b.data(), 2});
    }
    n_shared_ = values_.size();
    for (const auto& T : cal.T_rig_board) {
      if (T)
        add(T_rig_board_, T->qt);
      else
        T_rig_board_.push_back(0);
    }
  }
  double* lens(int cam) { return &values_[lens_[cam]]; }
  double* T_cam_rig(int cam) { return &values_[T_cam_rig_[cam]]; }
  double* T_rig_board(int frame) { return &values_[T_rig_board_[frame]]; }
  /// Everything but the board poses, which come last, as one block.
  double* shared() { return values_.data(); }
  int n_shared() const { return static_cast<int>(n_shared_); }
  double* T_board0_board(int target) { return &values_[T_board0_board_[target]]; }
  double* bow(int target) { return &values_[bow_[target]]; }

  void write_to(Calibration& cal) const {
    for (std::size_t i = 0; i < lens_.size(); ++i) {
      const auto k = params(cal.rig.cameras[i].lens);
      std::copy_n(&values_[lens_[i]], k.size(), k.begin());
      std::copy_n(&values_[T_cam_rig_[i]], 7, cal.rig.T_cam_rig[i].qt.begin());
    }
    for (std::size_t i = 0; i < T_board0_board_.size(); ++i)
      std::copy_n(&values_[T_board0_board_[i]], 7, cal.T_board0_board[i].qt.begin());
    for (std::size_t i = 0; i < bow_.size(); ++i) {
      if (cal.bow_m[i]) std::copy_n(&values_[bow_[i]], 2, cal.bow_m[i]->data());
    }
    for (std::size_t f = 0; f < cal.T_rig_board.size(); ++f) {
      if (cal.T_rig_board[f]) std::copy_n(&values_[T_rig_board_[f]], 7, cal.T_rig_board[f]->qt.begin());
    }
  }

 private:
  void add(std::vector<std::size_t>& where, std::span<const double> block) {
    where.push_back(values_.size());
    values_.insert(values_.end(), block.begin(), block.end());
  }
  std::vector<double> values_;
  std::vector<std::size_t> lens_, T_cam_rig_, T_board0_board_, T_rig_board_, bow_;
  std::size_t n_shared_ = 0;
};

bool has_ties(const SolveSpec& spec) {
  for (std::size_t i = 0; i < spec.tied_to.size(); ++i) {
    if (spec.tied_to[i] != static_cast<int>(i) && !is_held(spec, static_cast<int>(i))) return true;
  }
  return false;
}

// Ties reach across blocks, so with any of them all shared parameters are one block: slower with many
// cameras, because each view's Jacobian then has the columns of all, but the manifold says it all.
void tie_shared(ceres::Problem& problem, Blocks& blocks, const Calibration& cal, const SolveSpec& spec) {
  const Offsets offsets = offsets_of(cal);
  const Reduction reduction = reduction_of(spec, offsets.total);
  std::vector<std::unique_ptr<ceres::Manifold>> parts;
  std::vector<int> column;
  for (std::size_t cam = 0; cam < cal.rig.cameras.size(); ++cam) {
    const int n = n_params(cal.rig.cameras[cam].lens), at = offsets.lens[cam];
    parts.push_back(std::make_unique<ceres::EuclideanManifold<ceres::DYNAMIC>>(n));
    for (int i = at; i < at + n; ++i) column.push_back(reduction.column[i]);
  }
  std::vector<int> poses = offsets.pose;
  poses.insert(poses.end(), offsets.board.begin(), offsets.board.end());
  for (int at : poses) {
    std::array<bool, 6> held{};
    for (int i = 0; i < 6; ++i) held[i] = at < 0 || is_held(spec, at + i);
    if (std::all_of(held.begin(), held.end(), [](bool h) { return h; })) {
      parts.push_back(std::make_unique<ceres::EuclideanManifold<ceres::DYNAMIC>>(7));
      column.insert(column.end(), 7, -1);
      continue;
    }
    parts.push_back(make_pose_manifold(held));
    for (int i = 0; i < 6; ++i) {
      if (!held[i]) column.push_back(reduction.column[at + i]);
    }
  }
  for (std::size_t i = 0; i < cal.bow_m.size(); ++i) {
    parts.push_back(std::make_unique<ceres::EuclideanManifold<ceres::DYNAMIC>>(2));
    const int at = offsets.bow[i];
    for (int n = 0; n < 2; ++n) column.push_back(at < 0 ? -1 : reduction.column[at + n]);
  }
  problem.SetManifold(blocks.shared(),
                      make_tied_manifold(std::move(parts), std::move(column), reduction.n_free).release());
}

// A prior of a camera that no view of the problem shows changes nothing and is left out.
void add_priors(ceres::Problem& problem, Blocks& blocks, const Calibration& cal, const SolveSpec& spec) {
  const Offsets offsets = offsets_of(cal);
  const bool tied = has_ties(spec);
  const auto add = [&](std::unique_ptr<ceres::CostFunction> cost, double* block) {
    if (tied) {
      cost = merge_blocks(std::move(cost), {static_cast<int>(block - blocks.shared())}, blocks.n_shared());
      problem.AddResidualBlock(cost.release(), nullptr, blocks.shared());
    } else if (problem.HasParameterBlock(block)) {
      problem.AddResidualBlock(cost.release(), nullptr, block);
    }
  };
  for (const PriorTerm& prior : spec.priors) {
    const double weight = spec.prior_weight / prior.sigma;
    const auto add_to_pose = [&](int first, double* block) {
      const int i = prior.index - first;
      if (first >= 0 && i >= 0 && i < 6) add(make_pose_prior_cost(i, prior.value, weight), block);
    };
    for (int cam = 0; cam < static_cast<int>(cal.rig.cameras.size()); ++cam) {
      const int n = n_params(cal.rig.cameras[cam].lens), i = prior.index - offsets.lens[cam];
      if (i >= 0 && i < n) add(make_prior_cost(n, i, prior.value, weight), blocks.lens(cam));
      add_to_pose(offsets.pose[cam], blocks.T_cam_rig(cam));
    }
    for (int b = 1; b < static_cast<int>(cal.data.targets.size()); ++b)
      add_to_pose(offsets.board[b], blocks.T_board0_board(b));
    for (int b = 0; b < static_cast<int>(cal.bow_m.size()); ++b) {
      const int i = prior.index - offsets.bow[b];
      if (offsets.bow[b] >= 0 && i >= 0 && i < 2)
        add(make_prior_cost(2, i, prior.value, weight), blocks.bow(b));
    }
  }
}

// A guard of a camera that no view of the problem shows is left out. \param n_residuals  of each camera
void add_guards(ceres::Problem& problem, Blocks& blocks, const Calibration& cal, const SolveSpec& spec,
                const std::vector<int>& n_residuals) {
  for (const RadialGuard& guard : spec.guards) {
    if (n_residuals[guard.cam] == 0) continue;
    auto cost = make_radial_guard(cal.rig.cameras[guard.cam].lens, guard);
    double* block = blocks.lens(guard.cam);
    if (cost && has_ties(spec)) {
      cost = merge_blocks(std::move(cost), {static_cast<int>(block - blocks.shared())}, blocks.n_shared());
      problem.AddResidualBlock(cost.release(), nullptr, blocks.shared());
    } else if (cost) {
      problem.AddResidualBlock(cost.release(), nullptr, block);
    }
  }
}

// What a view depends on: its costs and the parameter blocks in the costs' order. A lens with sparse
// derivatives has a cost for each corner, and its core in a block of its own.
struct ViewBlocks {
  std::vector<std::unique_ptr<ceres::CostFunction>> costs;
  std::vector<double*> parameters;
};
ViewBlocks view_blocks(const std::shared_ptr<Lens>& lens, const View& view, bool bowed,
                       std::vector<Observation> observations, Blocks& blocks, const SolveSpec& spec) {
  double *k = blocks.lens(view.cam), *T_rig_board = blocks.T_rig_board(view.frame);
  ViewBlocks list{{}, {k}};
  if (is_sparse(*lens)) {
    for (const Observation& o : observations)
      list.costs.push_back(make_sparse_cost(lens, {o}, spec.loss, spec.loss_scale, view.target > 0, bowed));
    list.parameters.push_back(k + 4);
  } else {
    list.costs.push_back(
        make_view_cost(*lens, std::move(observations), spec.loss, spec.loss_scale, view.target > 0, bowed));
  }
  list.parameters.insert(list.parameters.end(), {blocks.T_cam_rig(view.cam), T_rig_board});
  if (view.target > 0) list.parameters.push_back(blocks.T_board0_board(view.target));
  if (bowed) list.parameters.push_back(blocks.bow(view.target));
  if (!has_ties(spec)) return list;
  std::vector<int> at;
  for (const double* block : list.parameters)
    at.push_back(block == T_rig_board ? -1 : static_cast<int>(block - blocks.shared()));
  for (auto& cost : list.costs) cost = merge_blocks(std::move(cost), at, blocks.n_shared());
  list.parameters = {blocks.shared(), T_rig_board};
  return list;
}

// All views with their manifolds and the order of elimination.
void add_views(ceres::Problem& problem, ceres::ParameterBlockOrdering& ordering, Blocks& blocks,
               const Calibration& cal, const SolveSpec& spec, std::vector<int>& n_residuals) {
  const Offsets offsets = offsets_of(cal);
  const bool tied = has_ties(spec);
  std::vector<std::shared_ptr<Lens>> lenses;
  for (const Camera& camera : cal.rig.cameras) lenses.push_back(std::make_shared<Lens>(camera.lens));
  std::vector<bool> lens_seen(cal.rig.cameras.size(), false), board_seen(cal.data.targets.size(), false),
      bow_seen(cal.data.targets.size(), false);
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    std::vector<Observation> observations = observations_of(cal, v, spec.use_sigma);
    if (observations.empty()) continue;
    const int cam = cal.data.views[v].cam, target = cal.data.views[v].target;
    double* T_rig_board = blocks.T_rig_board(cal.data.views[v].frame);
    n_residuals[cam] += 2 * static_cast<int>(observations.size());
    const bool bowed = offsets.bow[target] >= 0;
    ViewBlocks view =
        view_blocks(lenses[cam], cal.data.views[v], bowed, std::move(observations), blocks, spec);
    for (auto& cost : view.costs) problem.AddResidualBlock(cost.release(), nullptr, view.parameters);
    if (spec.hold_boards)
      problem.SetParameterBlockConstant(T_rig_board);
    else if (!problem.HasManifold(T_rig_board))
      problem.SetManifold(T_rig_board, make_pose_manifold().release());
    ordering.AddElementToGroup(T_rig_board, 0);  // board poses are eliminated first
    if (tied) continue;
    if (target > 0 && !board_seen[target]) {
      board_seen[target] = true;
      hold_pose(problem, blocks.T_board0_board(target), offsets.board[target], spec);
      ordering.AddElementToGroup(blocks.T_board0_board(target), 1);
    }
    if (bowed && !bow_seen[target]) {
      bow_seen[target] = true;
      hold_block(problem, blocks.bow(target), 2, offsets.bow[target], spec);
      ordering.AddElementToGroup(blocks.bow(target), 1);
    }
    if (lens_seen[cam]) continue;
    lens_seen[cam] = true;
    hold_lens(problem, *lenses[cam], blocks.lens(cam), offsets.lens[cam], spec);
    ordering.AddElementToGroup(blocks.lens(cam), 1);
    if (cam == 0)
      problem.SetParameterBlockConstant(blocks.T_cam_rig(cam));  // the rig's frame is camera 0's
    else
      hold_pose(problem, blocks.T_cam_rig(cam), offsets.pose[cam], spec);
    ordering.AddElementToGroup(blocks.T_cam_rig(cam), 1);
  }
  if (!tied || problem.NumResiduals() == 0) return;
  tie_shared(problem, blocks, cal, spec);
  ordering.AddElementToGroup(blocks.shared(), 1);
}

SolveReport report_of(const ceres::Solver::Summary& summary, const Calibration& cal) {
  SolveReport report;
  report.usable = summary.IsSolutionUsable() && all_finite(cal);
  report.converged = summary.termination_type == ceres::CONVERGENCE;
  report.cost = summary.final_cost;
  report.iterations = std::max(0, static_cast<int>(summary.iterations.size()) - 1);
  report.termination = one_line(summary.message);
  return report;
}

// Which parameters a corner touches changes as it moves.
void solve_sparsely(ceres::Solver::Options& options) {
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.dynamic_sparsity = true;
  options.linear_solver_ordering.reset();
}

// `block`: the parameters after the core.
void add_regularisation(ceres::Problem& problem, const Lens& lens, double* block, int n_residuals) {
  const double scale = prior_scale(n_residuals, n_params(lens));
  for (const PriorRow& row : priors(lens))
    problem.AddResidualBlock(make_prior_cost(row, n_params(lens), scale).release(), nullptr, block);
}

}  // namespace

SolveReport solve_ceres(Calibration& cal, const SolveSpec& spec) {
  if (has_clocks(cal)) return solve_moving(cal, spec);
  Blocks blocks(cal);
  ceres::Problem problem;
  auto* ordering = new ceres::ParameterBlockOrdering;
  ceres::Solver::Options options = solver_options(spec);
  options.linear_solver_ordering.reset(ordering);
  std::vector<int> n_residuals(cal.rig.cameras.size(), 0);
  add_views(problem, *ordering, blocks, cal, spec, n_residuals);
  for (std::size_t cam = 0; cam < n_residuals.size(); ++cam) {
    const Lens& lens = cal.rig.cameras[cam].lens;
    if (n_residuals[cam] == 0 || !is_sparse(lens)) continue;
    if (has_ties(spec)) return {.termination = "parameters cannot be tied in a rig with a splined lens"};
    add_regularisation(problem, lens, blocks.lens(static_cast<int>(cam)) + 4, n_residuals[cam]);
    solve_sparsely(options);
  }
  if (problem.NumResiduals() == 0) return {.termination = "no corner to use"};
  add_priors(problem, blocks, cal, spec);
  add_guards(problem, blocks, cal, spec, n_residuals);
  ceres::Solver::Summary summary;
  const QuietLog quiet;
  ceres::Solve(options, &problem, &summary);
  blocks.write_to(cal);
  return report_of(summary, cal);
}

SolveReport solve(Calibration& cal, const SolveSpec& spec) {
  if (spec.solver == Solver::kCeres || !block_solver_can(cal, spec)) return solve_ceres(cal, spec);
  return solve_blocks(cal, spec);
}

}  // namespace plumbline::detail
