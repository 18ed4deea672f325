// SPDX-License-Identifier: Apache-2.0
// White box: the bare solve, as calibrate() calls it once outliers are marked.
#include "refine/solve.hpp"
#include "solve/tools.hpp"

namespace bench {
namespace {

// Of the corners alone: the cost of a splined lens has its regularisation besides.
double rms_xy_px(plumbline::Calibration& cal) {
  plumbline::detail::evaluate(cal);
  double sum = 0;
  std::size_t n = 0;
  for (const auto& fits : cal.fits) {
    for (const auto& fit : fits) sum += fit.residual_px.squaredNorm();
    n += 2 * fits.size();
  }
  return std::sqrt(sum / static_cast<double>(n));
}

std::optional<Outcome> run(SolveSet& set, plumbline::Solver solver, int n_threads) {
  Outcome outcome;
  plumbline::Calibration& cal = set.start;
  plumbline::detail::SolveSpec spec{.max_iterations = 500, .solver = solver, .n_threads = n_threads};
  spec.held.assign(plumbline::shared_parameter_names(cal).size(), false);
  plumbline::detail::hold_cores(cal.rig, spec.held);
  const Stopwatch watch;
  const auto report = plumbline::detail::solve(cal, spec);
  watch.stop(outcome);
  if (!report.usable) return std::nullopt;
  outcome.rms_xy_px = rms_xy_px(cal);
  outcome.iterations = report.iterations;
  outcome.rig = cal.rig;
  return outcome;
}

}  // namespace

std::optional<Outcome> run_plumbline(SolveSet& set, int n_threads) {
  return run(set, plumbline::Solver::kBlocks, n_threads);
}

std::optional<Outcome> run_procedure(SolveSet& set, int n_threads) {
  plumbline::RefineOptions options;
  options.lenses = {plumbline::lens_spec(set.start.rig.cameras[0].lens)};
  options.n_threads = n_threads;
  Outcome outcome;
  const Stopwatch watch;
  const auto cal = plumbline::calibrate(set.start.data, options);
  watch.stop(outcome);
  if (!cal) return std::nullopt;
  outcome.rms_xy_px = cal->stats.rms_xy_px;
  outcome.rig = cal->rig;
  return outcome;
}

std::optional<Outcome> run_our_ceres(SolveSet& set) { return run(set, plumbline::Solver::kCeres, 1); }

}  // namespace bench
