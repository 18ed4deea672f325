// SPDX-License-Identifier: Apache-2.0
#include "plumbline/core/parallel.hpp"
#include "refine/block_normal.hpp"
#include "refine/block_runs.hpp"

namespace plumbline::detail {
namespace {

// Which control points the views of a frame need; false when a corner lies outside its grid.
bool find_patches(const BlockProblem& problem, const BlockState& state, std::size_t f, BlockNormal& normal) {
  std::vector<SplinePatch>& patches = normal.couplings[f].patches;
  for (const BlockSpline& spline : problem.splines) {
    const auto& lens = std::get<Splined>(state.lenses[spline.cam]);
    SplinePatch patch(lens, spline.cam);
    bool seen = false;
    for (const BlockView& view : problem.frames[f].views) {
      if (view.cam != spline.cam) continue;
      seen = true;
      int* knots = &normal.knots[view.knots_at];
      if (!place_corners(lens, pose_in_camera(state, view, f), view.corners, knots)) return false;
      patch.add(lens, knots, view.corners.n);
    }
    if (seen) patches.push_back(std::move(patch));
  }
  return true;
}

// The frame's segments again, each spline's control points behind its first four parameters.
void lay_out(const BlockProblem& problem, const BlockState& state, const std::vector<Segment>& without,
             Coupling& coupling) {
  coupling.segments.clear();
  int row = 0;
  for (const Segment& s : without) {
    coupling.segments.push_back(s);
    row += s.n;
    for (SplinePatch& patch : coupling.patches) {
      if (problem.offsets.lens[patch.cam] != s.first) continue;
      patch.lay_out(std::get<Splined>(state.lenses[patch.cam]), s.first, row, coupling.segments);
      row += patch.n_rows;
    }
  }
}

}  // namespace

bool couple_splines(const BlockProblem& problem, const BlockState& state, BlockNormal& normal) {
  const Runs runs(problem.frames.size());
  normal.couplings.assign(problem.frames.size(), {});
  normal.knots.resize(problem.n_knots);
  std::vector<char> ok(static_cast<std::size_t>(runs.n_runs), 1);
  problem.workers->run(runs.n_runs, [&](int run) {
    for (int i = runs.first(run); i < runs.first(run + 1); ++i) {
      const auto f = static_cast<std::size_t>(i);
      if (!find_patches(problem, state, f, normal)) {
        ok[static_cast<std::size_t>(run)] = 0;
        return;
      }
      lay_out(problem, state, problem.couplings[f].segments, normal.couplings[f]);
    }
  });
  for (const char run_ok : ok) {
    if (!run_ok) return false;
  }
  std::size_t n = 0;
  for (Coupling& coupling : normal.couplings) coupling.finish(n);
  return true;
}

}  // namespace plumbline::detail
