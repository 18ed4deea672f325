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
    const GuardRows rows = guard_rows(state.lenses[guard.cam], guard);
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
    const MatX J = guard_rows(state.lenses[guard.cam], guard).J;
    gradient.segment(at, J.cols()).noalias() += J.transpose() * guard_rows(other.lenses[guard.cam], guard).r;
  });
}

}  // namespace plumbline::detail
