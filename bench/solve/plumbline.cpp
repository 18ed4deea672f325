// SPDX-License-Identifier: Apache-2.0
// White box: the bare solve, as calibrate() calls it once outliers are marked.
#include "refine/solve.hpp"
#include "solve/tools.hpp"

namespace bench {
namespace {

std::optional<Outcome> run(SolveSet& set, plumbline::Solver solver, int n_threads) {
  Outcome outcome;
  plumbline::Calibration& cal = set.start;
  const Stopwatch watch;
  const auto report =
      plumbline::detail::solve(cal, {.max_iterations = 500, .solver = solver, .n_threads = n_threads});
  watch.stop(outcome);
  if (!report.usable) return std::nullopt;
  std::size_t n = 0;
  for (const auto& view : cal.data.views) n += 2 * view.corners.size();
  outcome.rms_xy_px = std::sqrt(2 * report.cost / static_cast<double>(n));
  outcome.iterations = report.iterations;
  outcome.rig = cal.rig;
  return outcome;
}

}  // namespace

std::optional<Outcome> run_plumbline(SolveSet& set, int n_threads) {
  return run(set, plumbline::Solver::kBlocks, n_threads);
}
std::optional<Outcome> run_our_ceres(SolveSet& set) { return run(set, plumbline::Solver::kCeres, 1); }

}  // namespace bench
