// SPDX-License-Identifier: Apache-2.0
#include "refine/block_extras.hpp"

#include <algorithm>

#include "refine/radial_guard.hpp"

namespace plumbline::detail {
namespace {

PriorRows priors_at(const BlockProblem& problem, const BlockState& state) {
  Calibration cal = problem.shared_only;
  for (std::size_t i = 0; i < state.lenses.size(); ++i) cal.rig.cameras[i].lens = state.lenses[i];
  cal.rig.T_cam_rig = state.T_cam_rig;
  cal.T_board0_board = state.T_board0_board;
  for (std::size_t i = 0; i < cal.bow_m.size(); ++i) {
    if (cal.bow_m[i]) cal.bow_m[i] = state.bow_m[i];
  }
  return prior_rows(cal, *problem.spec);
}

bool is_seen(const BlockProblem& problem, int cam) {
  return std::any_of(problem.frames.begin(), problem.frames.end(), [&](const BlockFrame& frame) {
    return std::any_of(frame.views.begin(), frame.views.end(),
                       [&](const BlockView& view) { return view.cam == cam; });
  });
}

// Calls visit(guard, index of the lens' first parameter) for each guard that takes part.
template <class Visit>
void for_each_guard(const BlockProblem& problem, Visit&& visit) {
  for (const RadialGuard& guard : problem.spec->guards) {
    if (is_seen(problem, guard.cam)) visit(guard, problem.offsets.lens[guard.cam]);
  }
}

}  // namespace

void add_extras(const BlockProblem& problem, const BlockState& state, BlockNormal& normal) {
  if (!problem.spec->priors.empty()) {
    const PriorRows rows = priors_at(problem, state);
    normal.cost += 0.5 * rows.r.squaredNorm();
    normal.A_ss += rows.J.transpose() * rows.J;
    normal.g_s += rows.J.transpose() * rows.r;
  }
  for_each_guard(problem, [&](const RadialGuard& guard, int at) {
    const GuardRows rows = one_sided(guard_rows(state.lenses[guard.cam], guard));
    const auto n = rows.J.cols();
    normal.cost += 0.5 * rows.r.squaredNorm();
    normal.A_ss.block(at, at, n, n).noalias() += rows.J.transpose() * rows.J;
    normal.g_s.segment(at, n).noalias() += rows.J.transpose() * rows.r;
  });
}

void add_mixed_extras(const BlockProblem& problem, const BlockState& state, const BlockState& other,
                      VecX& gradient) {
  if (!problem.spec->priors.empty())
    gradient += priors_at(problem, state).J.transpose() * priors_at(problem, other).r;
  for_each_guard(problem, [&](const RadialGuard& guard, int at) {
    const MatX J = one_sided(guard_rows(state.lenses[guard.cam], guard)).J;
    gradient.segment(at, J.cols()).noalias() +=
        J.transpose() * one_sided(guard_rows(other.lenses[guard.cam], guard)).r;
  });
}

StepLength guarded_length(const BlockProblem& problem, const BlockState& state, const BlockVector& step,
                          double slope, double curvature) {
  VecX r(0), d(0);  // of all rows: the residual, and its change over the full step
  for_each_guard(problem, [&](const RadialGuard& guard, int at) {
    const GuardRows rows = guard_rows(state.lenses[guard.cam], guard);
    const auto n = r.size(), more = rows.r.size();
    r.conservativeResize(n + more);
    d.conservativeResize(n + more);
    r.tail(more) = rows.r;
    d.tail(more) = rows.J * step.shared.segment(at, rows.J.cols());
  });
  // What the model lacks of row i at t, as a residual: it has r + t d of a row in force, whatever its sign.
  const auto lacks = [&](Eigen::Index i, double t) {
    const double x = r[i] + t * d[i];
    return r[i] > 0 ? std::min(0.0, x) : std::max(0.0, x);
  };
  const auto slope_at = [&](double t) {
    double sum = slope + t * curvature;
    for (Eigen::Index i = 0; i < r.size(); ++i) sum += (r[i] > 0 ? -1 : 1) * lacks(i, t) * d[i];
    return sum;
  };
  double low = 0, high = 1;
  for (int i = 0; i < 40 && slope_at(1) > 0; ++i) {
    const double middle = 0.5 * (low + high);
    (slope_at(middle) > 0 ? high : low) = middle;
  }
  StepLength out{high, -(high * slope + 0.5 * high * high * curvature)};
  for (Eigen::Index i = 0; i < r.size(); ++i)
    out.gain -= (r[i] > 0 ? -0.5 : 0.5) * lacks(i, high) * lacks(i, high);
  return out;
}

}  // namespace plumbline::detail
