// SPDX-License-Identifier: Apache-2.0
#include "refine/block_solve.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "plumbline/rig/motion.hpp"
#include "refine/block_extras.hpp"
#include "refine/block_normal.hpp"

namespace plumbline::detail {
namespace {

// Steps along a straight line are enough for ordinary lenses, and cost half.
constexpr int kPlainIterations = 10;
// An optimum is said to lie at the edge of the domain when a step was refused for it so shortly before.
constexpr int kEdgeMemory = 20;
constexpr int kMostJumps = 4;
// Their matrix is dense, and six of its size are alive at once: 430 MB for so many, which two cameras with
// 1200 control values each need.
constexpr int kMostShared = 3000;
constexpr double kFirstDamping = 1e-4, kMostDamping = 1e20, kLeastDamping = 1e-15, kUndamped = 1e-12;
// The cost is a sum of some ten thousand squares, good to some units in its last places.
constexpr double kRounding = 1e-13;
// A residual itself is good to some units in the last place of a pixel of a thousand.
constexpr double kRoundingPx = 1e-12;

// Below this a change of the cost is rounding. \param n  residuals
double rounding_of(double cost, double n) {
  return kRounding * cost + kRoundingPx * std::sqrt(2 * cost) + kRoundingPx * kRoundingPx * n;
}

BlockState state_of(const Calibration& cal, const BlockProblem& problem) {
  BlockState state;
  for (const Camera& camera : cal.rig.cameras) state.lenses.push_back(camera.lens);
  state.T_cam_rig = cal.rig.T_cam_rig;
  state.T_board0_board = cal.T_board0_board;
  for (std::size_t i = 0; i < cal.data.targets.size(); ++i)
    state.bow_m.push_back(bow_of(cal, static_cast<int>(i)).value_or(Vec2(0, 0)));
  for (const BlockFrame& frame : problem.frames) state.T_rig_board.push_back(*cal.T_rig_board[frame.frame]);
  return state;
}

void write_to(Calibration& cal, const BlockProblem& problem, const BlockState& state) {
  for (std::size_t i = 0; i < state.lenses.size(); ++i) cal.rig.cameras[i].lens = state.lenses[i];
  cal.rig.T_cam_rig = state.T_cam_rig;
  cal.T_board0_board = state.T_board0_board;
  for (std::size_t i = 0; i < state.bow_m.size(); ++i) {
    if (problem.offsets.bow[i] >= 0) cal.bow_m[i] = state.bow_m[i];
  }
  for (std::size_t f = 0; f < problem.frames.size(); ++f)
    cal.T_rig_board[problem.frames[f].frame] = state.T_rig_board[f];
}

BlockState moved(const BlockProblem& problem, const BlockState& state, const BlockVector& step) {
  BlockState next = state;
  for (std::size_t i = 0; i < next.lenses.size(); ++i) {
    const auto k = params(next.lenses[i]);
    for (std::size_t j = 0; j < k.size(); ++j)
      k[j] += step.shared[problem.offsets.lens[i] + static_cast<int>(j)];
  }
  const auto move = [&](SE3& T, int at) {
    if (at < 0) return;
    const Vec6 d = step.shared.segment<6>(at);
    if (!d.isZero(0)) T = box_plus(T, d);
  };
  for (std::size_t i = 0; i < next.T_cam_rig.size(); ++i) move(next.T_cam_rig[i], problem.offsets.pose[i]);
  for (std::size_t i = 0; i < next.T_board0_board.size(); ++i)
    move(next.T_board0_board[i], problem.offsets.board[i]);
  for (std::size_t i = 0; i < next.bow_m.size(); ++i) {
    if (problem.offsets.bow[i] >= 0) next.bow_m[i] += step.shared.segment<2>(problem.offsets.bow[i]);
  }
  for (std::size_t f = 0; f < next.T_rig_board.size(); ++f) {
    if (!step.boards[f].isZero(0)) next.T_rig_board[f] = box_plus(next.T_rig_board[f], step.boards[f]);
  }
  return next;
}

bool focal_lengths_positive(const BlockState& state) {
  return std::all_of(state.lenses.begin(), state.lenses.end(),
                     [](const Lens& lens) { return params(lens)[0] > 0 && params(lens)[1] > 0; });
}

// The numbers that move: not held, and with any effect on a residual.
Reduction free_numbers(const BlockNormal& normal, const SolveSpec& spec) {
  const int n = static_cast<int>(normal.g_s.size());
  Reduction all = reduction_of(spec, n);
  std::vector<double> effect(static_cast<std::size_t>(all.n_free), 0.0);
  for (int i = 0; i < n; ++i) {
    if (all.column[i] >= 0) effect[all.column[i]] += normal.A_ss(i, i);
  }
  std::vector<int> number(effect.size(), -1);
  all.n_free = 0;
  for (std::size_t c = 0; c < effect.size(); ++c) {
    if (effect[c] > 0) number[c] = all.n_free++;
  }
  for (int& column : all.column) column = column < 0 ? -1 : number[column];
  return all;
}

// Adds half the geodesic acceleration to a step, so that it follows a curved valley to second order
// (Transtrum & Sethna 2012): a = -(A + damping)^-1 J' r_vv, with the second derivative r_vv of the residuals
// along v by a finite difference. Left alone where the acceleration is large beside the step, and the step
// therefore not to be trusted.
void bend(const BlockProblem& problem, const BlockState& state, const BlockNormal& normal,
          const BlockFactor& factor, const BlockVector& g, BlockVector& v) {
  constexpr double h = 0.1, kMostBend = 0.75;
  BlockVector ahead = v;
  ahead.shared *= h;
  for (Vec6& d : ahead.boards) d *= h;
  const auto g_ahead = mixed_gradient(problem, state, moved(problem, state, ahead));
  if (!g_ahead) return;
  BlockVector second = times(problem, normal, v);
  second.shared = (g_ahead->shared - g.shared - h * second.shared) * (2 / (h * h));
  for (std::size_t f = 0; f < v.boards.size(); ++f)
    second.boards[f] = (g_ahead->boards[f] - g.boards[f] - h * second.boards[f]) * (2 / (h * h));
  const auto a = factor.step(second);
  if (!a || !(factor.scaled_square(*a) <= kMostBend * kMostBend * factor.scaled_square(v))) return;
  v.shared += 0.5 * a->shared;
  for (std::size_t f = 0; f < v.boards.size(); ++f) v.boards[f] += 0.5 * a->boards[f];
}

// Shortens a step to where guards that it does not know of end it. \param predicted  of the full step
// \return  of the shortened one
double shorten(const BlockProblem& problem, const BlockState& state, const BlockVector& g, double predicted,
               BlockVector& step) {
  double slope = g.shared.dot(step.shared);
  for (std::size_t f = 0; f < step.boards.size(); ++f) slope += g.boards[f].dot(step.boards[f]);
  const StepLength to = guarded_length(problem, state, step, slope, -2 * (predicted + slope));
  step.shared *= to.length;
  for (Vec6& d : step.boards) d *= to.length;
  return to.gain;
}

}  // namespace

bool block_solver_can(const Calibration& cal, const SolveSpec& spec) {
  if (has_clocks(cal)) return false;
  const Offsets offsets = offsets_of(cal);
  if (offsets.total > kMostShared) return false;
  if (spec.held.empty()) return true;
  std::vector<int> poses = offsets.pose;
  poses.insert(poses.end(), offsets.board.begin(), offsets.board.end());
  for (int at : poses) {
    if (at < 0) continue;
    const int n_held = spec.held[at] + spec.held[at + 1] + spec.held[at + 2];
    if (n_held == 1 || n_held == 2) return false;
  }
  return true;
}

SolveReport solve_blocks(Calibration& cal, const SolveSpec& spec) {
  const BlockProblem problem = block_problem(cal, spec);
  SolveReport report;
  if (problem.frames.empty()) return {.termination = "no corner to use"};
  BlockState state = state_of(cal, problem);
  BlockNormal normal, next_normal;
  if (!make_normal(problem, state, normal))
    return {.termination = "a corner lies outside its lens' domain at the start"};
  // The control points of a splined lens creep towards their optimum by a tenth or so a step: what 1e-12 of
  // the cost leaves is some 1e-4 of a standard deviation, and the last steps to 1e-14 change nothing else.
  const double tight = problem.splines.empty() ? 1e-14 : 1e-12;
  const double tolerance = spec.tight ? tight : 1e-7;
  double n_residuals = 0;
  for (const BlockFrame& frame : problem.frames)
    for (const BlockView& view : frame.views) n_residuals += 2 * view.corners.n;
  BlockFactor factor;
  double damping = kFirstDamping, growth = 2;
  // A guard has no second derivative where it comes into force: steps end there and are not bent.
  const bool smooth = spec.guards.empty();
  int n_jumps = 0;
  int last_edge = -kEdgeMemory;  // the last iteration whose step left the domain
  report.termination = fmt::format("{} iterations without reaching the optimum", spec.max_iterations);
  while (report.iterations < spec.max_iterations) {
    ++report.iterations;
    const BlockVector g = gradient(normal);
    auto step = factor.make(problem, normal, free_numbers(normal, spec), spec.hold_boards, damping)
                    ? factor.step(g)
                    : std::nullopt;
    double gain = 0, predicted = 0;
    if (step) {
      predicted = factor.predicted_gain(g, *step);
      if (!smooth) predicted = shorten(problem, state, g, predicted, *step);
      if (predicted <= tolerance * normal.cost + kRoundingPx * kRoundingPx * n_residuals) {
        // In a flat valley the damping alone can make the step small: only an undamped one tells.
        if (damping <= kUndamped) {
          report.converged = true;
          report.termination = fmt::format("converged: the next step would lower the cost by {:.1e} of it",
                                           normal.cost > 0 ? predicted / normal.cost : 0.0);
          break;
        }
        damping = std::max(1e-3 * damping, kLeastDamping);
        continue;
      }
      if (report.iterations > kPlainIterations && smooth && problem.splines.empty())
        bend(problem, state, normal, factor, g, *step);
      BlockState next = moved(problem, state, *step);
      if (focal_lengths_positive(next)) {
        if (make_normal(problem, next, next_normal))
          gain = normal.cost - next_normal.cost;
        else
          last_edge = report.iterations;
        if (gain > 0) {
          state = std::move(next);
          std::swap(normal, next_normal);
        }
      }
    }
    if (gain > 0) {  // Nielsen 1999
      const double ratio = 2 * gain / predicted - 1;
      damping = std::max(kLeastDamping,
                         damping * (ratio > 0.8 ? 0.1 : std::max(1.0 / 3, 1 - ratio * ratio * ratio)));
      growth = 2;
    } else if (step && predicted <= rounding_of(normal.cost, n_residuals) && damping > kUndamped &&
               n_jumps < kMostJumps) {
      // Damped so much that a step gains nothing: only a freer one tells whether there is anything to gain.
      ++n_jumps;
      damping = std::max(1e-3 * damping, kLeastDamping);
      growth = 2;
    } else if (step && predicted <= rounding_of(normal.cost, n_residuals)) {
      report.converged = true;
      report.termination = "converged: rounding hides what is left to gain";
      break;
    } else {
      damping *= growth;
      growth *= 2;
      if (damping > kMostDamping) {
        report.termination = "no step lowers the cost";
        break;
      }
    }
  }
  if (report.iterations - last_edge < kEdgeMemory)
    report.termination += "; it lies at the edge of a lens' domain, so the views do not determine this lens";
  report.cost = normal.cost;
  report.usable = std::isfinite(report.cost);
  write_to(cal, problem, state);
  return report;
}

}  // namespace plumbline::detail
