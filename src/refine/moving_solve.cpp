// SPDX-License-Identifier: Apache-2.0
#include "refine/moving_solve.hpp"

#include <ceres/cost_function.h>
#include <ceres/manifold.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>

#include "refine/moving_cost.hpp"
#include "refine/quiet_log.hpp"

namespace plumbline::detail {
namespace {

// One block of parameters: where its numbers are, and where its steps count.
struct Block {
  std::size_t at = 0;  // in the values
  int size = 0;
  int column = -1;  // in shared_parameter_names(), or of a pose in the order of time; -1: constant
  bool is_pose = false, is_frame = false;
};

struct Term {
  std::unique_ptr<ceres::CostFunction> cost;
  std::vector<int> blocks;
};

// Everything that moves, in one array, for Ceres orders blocks by address.
struct MovingProblem {
  std::vector<double> values;
  std::vector<Block> blocks;
  std::vector<int> lens, T_cam_rig, T_board0_board, bow, delay, offset,
      T_rig_board;          // indices of blocks, or -1
  std::vector<int> frames;  // by time
  std::vector<Term> terms;
  int n_shared = 0;

  int add(std::span<const double> x, int column, bool is_pose, bool is_frame = false) {
    blocks.push_back({values.size(), static_cast<int>(x.size()), column, is_pose, is_frame});
    values.insert(values.end(), x.begin(), x.end());
    return static_cast<int>(blocks.size()) - 1;
  }
  double* at(int block) { return &values[blocks[static_cast<std::size_t>(block)].at]; }
  const double* at(int block) const { return &values[blocks[static_cast<std::size_t>(block)].at]; }
};

void add_shared(MovingProblem& p, const Calibration& cal) {
  const Offsets offsets = offsets_of(cal);
  p.n_shared = offsets.total;
  for (std::size_t i = 0; i < cal.rig.cameras.size(); ++i) {
    p.lens.push_back(p.add(params(cal.rig.cameras[i].lens), offsets.lens[i], false));
    p.T_cam_rig.push_back(p.add(cal.rig.T_cam_rig[i].qt, offsets.pose[i], true));
    const double delay = cal.clocks[i].line_delay_s.value_or(0.0),
                 offset = cal.clocks[i].time_offset_s.value_or(0.0);
    p.delay.push_back(p.add({&delay, 1}, offsets.line_delay[i], false));
    p.offset.push_back(p.add({&offset, 1}, offsets.time_offset[i], false));
  }
  for (std::size_t i = 0; i < cal.data.targets.size(); ++i) {
    p.T_board0_board.push_back(p.add(cal.T_board0_board[i].qt, offsets.board[i], true));
    const auto bow = bow_of(cal, static_cast<int>(i));
    p.bow.push_back(bow ? p.add({bow->data(), 2}, offsets.bow[i], false) : -1);
  }
}

MovingProblem make_problem(const Calibration& cal, const SolveSpec& spec) {
  MovingProblem p;
  add_shared(p, cal);
  const Trajectory trajectory = trajectory_of(cal);
  for (std::size_t f = 0; f < trajectory.stencils.size(); ++f) {
    if (trajectory.stencils[f]) p.frames.push_back(static_cast<int>(f));
  }
  std::stable_sort(p.frames.begin(), p.frames.end(),
                   [&](int a, int b) { return *trajectory.time_s[a] < *trajectory.time_s[b]; });
  p.T_rig_board.assign(cal.T_rig_board.size(), -1);
  for (std::size_t i = 0; i < p.frames.size(); ++i) {
    const int f = p.frames[i];
    p.T_rig_board[f] = p.add(cal.T_rig_board[f]->qt, static_cast<int>(6 * i), true, true);
  }
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    const View& view = cal.data.views[v];
    std::vector<Observation> observations = observations_of(cal, v, spec.use_sigma);
    const auto& stencil = trajectory.stencils[view.frame];
    if (observations.empty() || !stencil || !view.time_s) continue;
    const ImageSize size = cal.rig.cameras[view.cam].size;
    const bool bowed = p.bow[view.target] >= 0;
    Term term;
    term.cost = make_moving_cost({cal.rig.cameras[view.cam].lens, std::move(observations), *stencil,
                                  *view.time_s - *trajectory.time_s[view.frame], 0.5 * (size.height - 1),
                                  spec.loss, spec.loss_scale, view.target > 0, bowed});
    term.blocks = {p.lens[view.cam], p.T_cam_rig[view.cam]};
    for (int f : stencil->frames) term.blocks.push_back(p.T_rig_board[f]);
    term.blocks.push_back(p.delay[view.cam]);
    term.blocks.push_back(p.offset[view.cam]);
    if (view.target > 0) term.blocks.push_back(p.T_board0_board[view.target]);
    if (bowed) term.blocks.push_back(p.bow[view.target]);
    p.terms.push_back(std::move(term));
  }
  return p;
}

void set_manifold(ceres::Problem& problem, double* x, const Block& block, const SolveSpec& spec) {
  const int n_steps = block.is_pose ? 6 : block.size;
  std::vector<int> held;
  for (int i = 0; i < n_steps; ++i) {
    const bool is_held = block.is_frame
                             ? spec.hold_boards
                             : block.column < 0 || (!spec.held.empty() && spec.held[block.column + i]);
    if (is_held) held.push_back(i);
  }
  if (static_cast<int>(held.size()) == n_steps) {
    problem.SetParameterBlockConstant(x);
  } else if (block.is_pose) {
    std::array<bool, 6> mask{};
    for (int i : held) mask[i] = true;
    problem.SetManifold(x, make_pose_manifold(mask).release());
  } else if (!held.empty()) {
    problem.SetManifold(x, new ceres::SubsetManifold(block.size, held));
  }
}

void write_to(Calibration& cal, const MovingProblem& p) {
  const auto pose = [&](int block, SE3& T) { std::copy_n(p.at(block), 7, T.qt.begin()); };
  for (std::size_t i = 0; i < cal.rig.cameras.size(); ++i) {
    const auto k = params(cal.rig.cameras[i].lens);
    std::copy_n(p.at(p.lens[i]), k.size(), k.begin());
    pose(p.T_cam_rig[i], cal.rig.T_cam_rig[i]);
    if (cal.clocks[i].line_delay_s) cal.clocks[i].line_delay_s = *p.at(p.delay[i]);
    if (cal.clocks[i].time_offset_s) cal.clocks[i].time_offset_s = *p.at(p.offset[i]);
  }
  for (std::size_t i = 0; i < cal.data.targets.size(); ++i) {
    pose(p.T_board0_board[i], cal.T_board0_board[i]);
    if (p.bow[i] >= 0) cal.bow_m[i] = Vec2(p.at(p.bow[i])[0], p.at(p.bow[i])[1]);
  }
  for (int f : p.frames) pose(p.T_rig_board[f], *cal.T_rig_board[f]);
}

// Of a positive definite matrix with `width` entries below the diagonal, column by column in its lower band:
// L in place (A = L L'), and L^-1 B in B. A pivot that rounding has eaten counts as huge: what it stands for
// is not determined and takes nothing away.
void eliminate(MatX& band, MatX& B) {
  const Eigen::Index n = band.cols(), width = band.rows() - 1;
  for (Eigen::Index k = 0; k < n; ++k) {
    const Eigen::Index below = std::min(width, n - 1 - k);
    const double pivot = band(0, k) > 0 ? std::sqrt(band(0, k)) : 1e150;
    band(0, k) = pivot;
    band.col(k).segment(1, below) /= pivot;
    B.row(k) /= pivot;
    for (Eigen::Index i = 1; i <= below; ++i) {
      const double l = band(i, k);
      if (l == 0) continue;
      band.col(k + i).head(below - i + 1) -= l * band.col(k).segment(i, below - i + 1);
      B.row(k + i) -= l * B.row(k);
    }
  }
}

}  // namespace

SolveReport solve_moving(Calibration& cal, const SolveSpec& spec) {
  MovingProblem p = make_problem(cal, spec);
  if (p.terms.empty()) return {.termination = "no corner to use"};
  ceres::Problem problem;
  std::vector<bool> used(p.blocks.size(), false);
  for (Term& term : p.terms) {
    std::vector<double*> x;
    for (int b : term.blocks) {
      x.push_back(p.at(b));
      used[b] = true;
    }
    problem.AddResidualBlock(term.cost.release(), nullptr, x);
  }
  for (std::size_t b = 0; b < p.blocks.size(); ++b) {
    if (used[b]) set_manifold(problem, p.at(static_cast<int>(b)), p.blocks[b], spec);
  }
  ceres::Solver::Options options;
  options.max_num_iterations = spec.max_iterations;
  options.function_tolerance = spec.tight ? 1e-14 : 1e-7;
  options.parameter_tolerance = spec.tight ? 1e-12 : 1e-8;
  options.gradient_tolerance = spec.tight ? 1e-12 : 1e-10;
  options.num_threads = 1;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_consecutive_invalid_steps = 30;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  const QuietLog quiet;
  ceres::Solve(options, &problem, &summary);
  write_to(cal, p);
  SolveReport report;
  report.usable = summary.IsSolutionUsable() &&
                  std::all_of(p.values.begin(), p.values.end(), [](double x) { return std::isfinite(x); });
  report.converged = summary.termination_type == ceres::CONVERGENCE;
  report.cost = summary.final_cost;
  report.iterations = std::max(0, static_cast<int>(summary.iterations.size()) - 1);
  report.termination = summary.message;
  std::replace(report.termination.begin(), report.termination.end(), '\n', ' ');
  return report;
}

MovingNormal moving_normal(const Calibration& cal, const SolveSpec& spec) {
  MovingProblem p = make_problem(cal, spec);
  MovingNormal normal{MatX::Zero(p.n_shared, p.n_shared), 0, 0, static_cast<int>(p.frames.size())};
  const Eigen::Index n_poses = 6 * normal.n_frames;
  MatX band = MatX::Zero(6 * kMotionFrames, n_poses), B = MatX::Zero(n_poses, p.n_shared);
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  for (const Term& term : p.terms) {
    const int n = term.cost->num_residuals();
    std::vector<const double*> x;
    std::vector<RowMajor> J;
    std::vector<double*> out;
    for (int b : term.blocks) {
      x.push_back(p.at(b));
      J.emplace_back(n, p.blocks[b].size);
    }
    for (RowMajor& block : J) out.push_back(block.data());
    VecX r(n);
    if (!term.cost->Evaluate(x.data(), r.data(), out.data())) continue;
    normal.sum += r.squaredNorm();
    normal.n_residuals += n;
    for (std::size_t i = 0; i < J.size(); ++i) {
      const Block& a = p.blocks[term.blocks[i]];
      if (a.column < 0) continue;
      const auto J_a = J[i].leftCols(a.is_pose ? 6 : a.size);
      for (std::size_t k = 0; k < J.size(); ++k) {
        const Block& b = p.blocks[term.blocks[k]];
        if (b.column < 0 || (b.is_frame && !a.is_frame)) continue;
        const MatX H = J_a.transpose() * J[k].leftCols(b.is_pose ? 6 : b.size);
        if (!a.is_frame) {
          normal.S.block(a.column, b.column, H.rows(), H.cols()) += H;
        } else if (!b.is_frame) {
          B.block(a.column, b.column, H.rows(), H.cols()) += H;
        } else {
          for (Eigen::Index row = 0; row < 6; ++row) {
            for (Eigen::Index c = 0; c < 6; ++c) {
              const Eigen::Index below = a.column + row - b.column - c;
              if (below >= 0) band(below, b.column + c) += H(row, c);
            }
          }
        }
      }
    }
  }
  eliminate(band, B);
  normal.S.noalias() -= B.transpose() * B;
  return normal;
}

}  // namespace plumbline::detail
