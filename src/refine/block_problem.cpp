// SPDX-License-Identifier: Apache-2.0
// What the block solver is to solve, laid out once before its first step.
#include <algorithm>
#include <utility>

#include "plumbline/rig/calibration.hpp"
#include "refine/block_normal.hpp"
#include "refine/sparse_cost.hpp"

namespace plumbline::detail {
namespace {

void add_segment(std::vector<Segment>& list, int first, int n) {
  for (const Segment& s : list) {
    if (s.first == first) return;
  }
  list.push_back({first, n});
}

// Which parameters are dense, and how much each spline's regularisation weighs.
void divide_parameters(const Calibration& cal, const std::vector<int>& n_residuals, BlockProblem& problem) {
  problem.dense.assign(static_cast<std::size_t>(problem.offsets.total), 0);
  for (std::size_t i = 0; i < cal.rig.cameras.size(); ++i) {
    const Lens& lens = cal.rig.cameras[i].lens;
    if (!is_sparse(lens)) continue;
    const auto first = problem.dense.begin() + problem.offsets.lens[i];
    std::fill(first + 4, first + n_params(lens), -1);
    if (n_residuals[i] == 0) continue;
    BlockSpline& spline = problem.splines.emplace_back();
    spline.cam = static_cast<int>(i);
    spline.prior_scale = prior_scale(n_residuals[i], n_params(lens));
    if (i > 0) spline.shared.push_back({problem.offsets.pose[i], 6});
    for (int at : problem.offsets.board)
      if (at >= 0) spline.shared.push_back({at, 6});
    for (int at : problem.offsets.bow)
      if (at >= 0) spline.shared.push_back({at, 2});
  }
  for (int i = 0; i < problem.offsets.total; ++i) {
    if (problem.dense[i] < 0) continue;
    problem.dense[i] = static_cast<int>(problem.from_dense.size());
    problem.from_dense.push_back(i);
  }
}

}  // namespace

void Coupling::finish(std::size_t& n_before) {
  n_rows = 0;
  for (const Segment& s : segments) n_rows += s.n;
  at = n_before;
  n_before += 6 * static_cast<std::size_t>(n_rows);
}

int BlockSpline::column_of(int parameter) const {
  int column = 2;
  for (const Segment& s : shared) {
    if (s.first == parameter) break;
    column += s.n;
  }
  return column;
}

BlockProblem block_problem(const Calibration& cal, const SolveSpec& spec) {
  BlockProblem problem;
  problem.offsets = offsets_of(cal);
  problem.loss = spec.loss;
  problem.loss_scale = spec.loss_scale;
  problem.spec = &spec;
  problem.workers = std::make_unique<Workers>(spec.n_threads);
  if (!spec.priors.empty()) {
    problem.shared_only.rig = cal.rig;
    problem.shared_only.data.targets = cal.data.targets;
    problem.shared_only.bow_m = cal.bow_m;
  }
  std::vector<ViewCorners> corners_of(cal.data.views.size());
  problem.workers->run(static_cast<int>(corners_of.size()), [&](int v) {
    const auto at = static_cast<std::size_t>(v);
    const std::vector<Observation> observations = observations_of(cal, at, spec.use_sigma);
    if (!observations.empty())
      corners_of[at] = view_corners(observations, problem.offsets.bow[cal.data.views[at].target] >= 0);
  });
  std::vector<int> place(cal.T_rig_board.size(), -1);
  std::shared_ptr<const std::vector<double>> last;
  std::vector<int> n_residuals(cal.rig.cameras.size(), 0);
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    ViewCorners& corners = corners_of[v];
    if (corners.n == 0) continue;
    if (last && *last == *corners.points) corners.points = last;  // fewer to keep in the processor's memory
    last = corners.points;
    const int cam = cal.data.views[v].cam, target = cal.data.views[v].target;
    const bool bowed = corners.bowed;
    int& at = place[cal.data.views[v].frame];
    if (at < 0) {
      at = static_cast<int>(problem.frames.size());
      problem.frames.emplace_back().frame = cal.data.views[v].frame;
      problem.couplings.emplace_back();
    }
    const Lens& lens = cal.rig.cameras[cam].lens;
    std::vector<Segment>& segments = problem.couplings[at].segments;
    n_residuals[cam] += 2 * corners.n;
    add_segment(segments, problem.offsets.lens[cam], is_sparse(lens) ? 4 : n_params(lens));
    if (cam > 0) add_segment(segments, problem.offsets.pose[cam], 6);
    if (target > 0) add_segment(segments, problem.offsets.board[target], 6);
    if (bowed) add_segment(segments, problem.offsets.bow[target], 2);
    problem.frames[at].views.push_back({cam, target, std::move(corners), problem.n_knots});
    if (is_sparse(lens))
      problem.n_knots += 2 * static_cast<std::size_t>(problem.frames[at].views.back().corners.n);
  }
  for (Coupling& coupling : problem.couplings) {
    std::sort(coupling.segments.begin(), coupling.segments.end(),
              [](const Segment& a, const Segment& b) { return a.first < b.first; });
    coupling.finish(problem.n_coupling);
  }
  divide_parameters(cal, n_residuals, problem);
  return problem;
}

}  // namespace plumbline::detail
