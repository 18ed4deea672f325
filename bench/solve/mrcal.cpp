// SPDX-License-Identifier: Apache-2.0
// The same least squares as the others: no outliers, no board warp, and no regularisation
// but that of a splined lens. White box: the
// conversion of crosscheck, whose optimise() adds rounds until nothing changes; here one round counts, as a
// user's call would.
#include "crosscheck/referee.hpp"
#include "solve/tools.hpp"

namespace bench {

using namespace plumbline;

std::optional<Outcome> run_mrcal(SolveSet& set) {
  std::vector<detail::RefereeLens> lenses;
  for (const Camera& camera : set.start.rig.cameras) {
    auto lens = detail::same_lens(camera.lens);
    if (!lens) return std::nullopt;
    lenses.push_back(*lens);
  }
  const auto lattice = detail::referee_lattice(set.start.data.targets[0]);
  detail::Problem problem = detail::make_problem(set.start, *lattice, lenses, false);
  const bool splined = holds_core(set.start.rig.cameras[0].lens);
  Outcome outcome;
  const Stopwatch watch;
  const auto rms = detail::optimise(
      problem, {.core = !splined, .distortion = true, .regularise = splined, .max_rounds = 1});
  watch.stop(outcome);
  if (!rms) return std::nullopt;
  outcome.rms_xy_px = *rms / std::sqrt(2.0);
  outcome.rig = set.start.rig;
  for (std::size_t cam = 0; cam < problem.intrinsics.size(); ++cam) {
    const auto k = params(outcome.rig.cameras[cam].lens);
    std::copy_n(problem.intrinsics[cam].begin(), k.size(), k.begin());
  }
  return outcome;
}

}  // namespace bench
