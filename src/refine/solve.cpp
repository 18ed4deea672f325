// SPDX-License-Identifier: Apache-2.0
#include "refine/solve.hpp"

#include <ceres/cost_function.h>
#include <ceres/manifold.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "plumbline/core/text.hpp"
#include "plumbline/rig/motion.hpp"
#include "refine/block_solve.hpp"
#include "refine/moving_solve.hpp"
#include "refine/quiet_log.hpp"
#include "refine/reprojection_cost.hpp"

namespace plumbline::detail {

bool takes_part(const Calibration& cal, std::size_t v) {
  return !cal.fits[v].empty() && cal.T_rig_board[cal.data.views[v].frame].has_value();
}

std::vector<Observation> observations_of(const Calibration& cal, std::size_t v, bool use_sigma) {
  std::vector<Observation> list;
  if (!takes_part(cal, v)) return list;
  const View& view = cal.data.views[v];
  for (std::size_t i = 0; i < view.corners.size(); ++i) {
    if (cal.fits[v][i].outlier) continue;
    const Corner& c = view.corners[i];
    const Target& target = cal.data.targets[view.target];
    list.push_back({target.points[c.point], c.px, use_sigma ? 1.0 / c.sigma_px : 1.0});
    if (target.outline) list.back().bow_shape = bow_shape(*target.outline, target.points[c.point]);
  }
  return list;
}

Offsets offsets_of(const Rig& rig) {
  Offsets o;
  o.board.push_back(-1);
  for (const Camera& camera : rig.cameras) {
    o.lens.push_back(o.total);
    o.total += n_params(camera.lens);
  }
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    o.pose.push_back(i == 0 ? -1 : o.total);
    if (i > 0) o.total += 6;
  }
  return o;
}

Offsets offsets_of(const Calibration& cal) {
  Offsets o = offsets_of(cal.rig);
  for (std::size_t i = 1; i < cal.data.targets.size(); ++i, o.total += 6) o.board.push_back(o.total);
  for (std::size_t i = 0; i < cal.data.targets.size(); ++i) {
    const bool bowed = bow_of(cal, static_cast<int>(i)).has_value();
    o.bow.push_back(bowed ? o.total : -1);
    if (bowed) o.total += 2;
  }
  for (std::size_t i = 0; i < cal.rig.cameras.size(); ++i) {
    const CameraClock clock = i < cal.clocks.size() ? cal.clocks[i] : CameraClock{};
    o.line_delay.push_back(clock.line_delay_s ? o.total++ : -1);
    o.time_offset.push_back(clock.time_offset_s ? o.total++ : -1);
  }
  return o;
}

namespace {

bool is_held(const SolveSpec& spec, int i) { return !spec.held.empty() && spec.held[i]; }

void hold_numbers(ceres::Problem& problem, double* block, int n, int offset, const SolveSpec& spec) {
  std::vector<int> held;
  for (int i = 0; i < n; ++i) {
    if (is_held(spec, offset + i)) held.push_back(i);
  }
  if (static_cast<int>(held.size()) == n)
    problem.SetParameterBlockConstant(block);
  else if (!held.empty())
    problem.SetManifold(block, new ceres::SubsetManifold(n, held));
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
};

}  // namespace

SolveReport solve_ceres(Calibration& cal, const SolveSpec& spec) {
  if (has_clocks(cal)) return solve_moving(cal, spec);
  Blocks blocks(cal);
  ceres::Problem problem;
  auto* ordering = new ceres::ParameterBlockOrdering;
  const Offsets offsets = offsets_of(cal);
  std::vector<bool> lens_seen(cal.rig.cameras.size(), false), board_seen(cal.data.targets.size(), false),
      bow_seen(cal.data.targets.size(), false);
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    std::vector<Observation> observations = observations_of(cal, v, spec.use_sigma);
    if (observations.empty()) continue;
    const int cam = cal.data.views[v].cam, target = cal.data.views[v].target;
    const Lens& lens = cal.rig.cameras[cam].lens;
    double* k = blocks.lens(cam);
    double* T_cam_rig = blocks.T_cam_rig(cam);
    double* T_rig_board = blocks.T_rig_board(cal.data.views[v].frame);
    std::vector<double*> parameters{k, T_cam_rig, T_rig_board};
    if (target > 0) parameters.push_back(blocks.T_board0_board(target));
    const bool bowed = offsets.bow[target] >= 0;
    if (bowed) parameters.push_back(blocks.bow(target));
    problem.AddResidualBlock(
        make_view_cost(lens, std::move(observations), spec.loss, spec.loss_scale, target > 0, bowed)
            .release(),
        nullptr, parameters);
    if (spec.hold_boards)
      problem.SetParameterBlockConstant(T_rig_board);
    else if (!problem.HasManifold(T_rig_board))
      problem.SetManifold(T_rig_board, make_pose_manifold().release());
    ordering->AddElementToGroup(T_rig_board, 0);  // board poses are eliminated first
    if (target > 0 && !board_seen[target]) {
      board_seen[target] = true;
      hold_pose(problem, blocks.T_board0_board(target), offsets.board[target], spec);
      ordering->AddElementToGroup(blocks.T_board0_board(target), 1);
    }
    if (bowed && !bow_seen[target]) {
      bow_seen[target] = true;
      hold_numbers(problem, blocks.bow(target), 2, offsets.bow[target], spec);
      ordering->AddElementToGroup(blocks.bow(target), 1);
    }
    if (lens_seen[cam]) continue;
    lens_seen[cam] = true;
    hold_numbers(problem, k, n_params(lens), offsets.lens[cam], spec);
    ordering->AddElementToGroup(k, 1);
    if (cam == 0)
      problem.SetParameterBlockConstant(T_cam_rig);  // the rig's frame is camera 0's
    else
      hold_pose(problem, T_cam_rig, offsets.pose[cam], spec);
    ordering->AddElementToGroup(T_cam_rig, 1);
  }
  ceres::Solver::Options options = solver_options(spec);
  options.linear_solver_ordering.reset(ordering);
  if (problem.NumResiduals() == 0) return {.termination = "no corner to use"};
  ceres::Solver::Summary summary;
  const QuietLog quiet;
  ceres::Solve(options, &problem, &summary);
  blocks.write_to(cal);
  SolveReport report;
  report.usable = summary.IsSolutionUsable() && all_finite(cal);
  report.converged = summary.termination_type == ceres::CONVERGENCE;
  report.cost = summary.final_cost;
  report.iterations = std::max(0, static_cast<int>(summary.iterations.size()) - 1);
  report.termination = one_line(summary.message);
  return report;
}

SolveReport solve(Calibration& cal, const SolveSpec& spec) {
  if (spec.solver == Solver::kCeres || !block_solver_can(cal, spec)) return solve_ceres(cal, spec);
  return solve_blocks(cal, spec);
}

int evaluate(Calibration& cal) {
  int n_lost = 0;
  const auto trajectory = has_clocks(cal) ? std::optional(trajectory_of(cal)) : std::nullopt;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    if (!takes_part(cal, v)) continue;
    const View& view = cal.data.views[v];
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      CornerFit& fit = cal.fits[v][i];
      const int point = view.corners[i].point;
      const auto px = trajectory ? predict(cal, *trajectory, view, point) : predict(cal, view, point);
      fit.residual_px = px ? Vec2(*px - view.corners[i].px) : Vec2::Zero();
      if (px) continue;
      fit.outlier = true;
      ++n_lost;
    }
  }
  return n_lost;
}

Result<std::vector<bool>> held_mask(const Calibration& cal, const std::vector<std::string>& fixed) {
  const std::vector<std::string> names = shared_parameter_names(cal);
  std::vector<bool> held(names.size(), false);
  for (const std::string& wanted : fixed) {
    bool found = false;
    for (std::size_t i = 0; i < names.size(); ++i) {
      // Camera names may hold spaces, parameter names do not: the parameter is what follows the last space.
      const std::string parameter = names[i].substr(names[i].rfind(' ') + 1);
      if (names[i] != wanted && parameter != wanted) continue;
      held[i] = true;
      found = true;
    }
    if (!found) {
      return Error{ErrorCode::kInvalidData,
                   "no shared parameter has this name; there are: " + join(names, ", "),
                   "fixed parameter '" + wanted + "'"};
    }
  }
  return held;
}

}  // namespace plumbline::detail
