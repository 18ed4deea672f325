// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/refine.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plumbline/core/check.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/rig/motion.hpp"
#include "refine/constraints.hpp"
#include "refine/effects.hpp"
#include "refine/lens_trial.hpp"
#include "refine/monotonic.hpp"
#include "refine/outliers.hpp"
#include "refine/preconditions.hpp"
#include "refine/recording.hpp"
#include "refine/seed.hpp"
#include "refine/solve.hpp"
#include "refine/suspects.hpp"
#include "refine/weak.hpp"

namespace plumbline {

namespace {

using namespace detail;

constexpr int kMarkingRounds = 5;

const char* name_of(Loss loss) {
  return loss == Loss::kSquared ? "squared" : loss == Loss::kHuber ? "huber" : "cauchy";
}
const char* name_of(Start start) {
  return start == Start::kAuto ? "auto" : start == Start::kZhang ? "zhang" : "dlt";
}

void fill_stats(Calibration& cal, const SolveReport& report) {
  SolveStats stats;
  double sum = 0;
  for (const auto& fits : cal.fits) {
    for (const CornerFit& fit : fits) {
      if (fit.outlier) {
        ++stats.n_outliers;
        continue;
      }
      sum += fit.residual_px.squaredNorm();
      ++stats.n_corners;
    }
  }
  stats.rms_px = stats.n_corners > 0 ? std::sqrt(sum / stats.n_corners) : 0.0;
  stats.rms_xy_px = stats.rms_px / std::sqrt(2.0);
  stats.iterations = report.iterations;
  stats.converged = report.converged;
  stats.termination = report.termination;
  cal.stats = stats;
}

void fill_provenance(Calibration& cal, const RefineOptions& options) {
  std::vector<std::string> lenses;
  for (const Camera& camera : cal.rig.cameras) lenses.push_back(lens_spec(camera.lens));
  auto& o = cal.provenance.options;
  o["lens"] = join(lenses, ",");
  o["start"] = name_of(options.start);
  o["loss"] = name_of(options.loss);
  if (options.loss != Loss::kSquared) o["loss_scale_px"] = format_double(options.loss_scale_px);
  o["outliers"] =
      options.mark_outliers ? "marked beyond " + format_double(options.outlier_sigma) + " sigma" : "kept";
  o["fixed"] = join(options.fixed, ",");
  std::vector<std::string> priors;
  for (const Prior& p : options.priors)
    priors.push_back(fmt::format("{}={}+-{}", p.parameter, format_double(p.value), format_double(p.sigma)));
  if (!options.ties.empty()) o["ties"] = join(options.ties, ",");
  if (!priors.empty()) o["priors"] = join(priors, ",");
  if (!options.only.empty()) o["only"] = join(options.only, ",");
  o["sigma"] = options.use_sigma ? "used" : "not used";
  for (const auto& [name, estimate] : {std::pair{"bow", options.bow},
                                       {"line_delay", options.line_delay},
                                       {"time_offset", options.time_offset}}) {
    if (estimate != Estimate::kNo) o[name] = estimate == Estimate::kYes ? "estimated" : "auto";
  }
  o["max_iterations"] = std::to_string(options.max_iterations);
  cal.provenance.corners_hash = corners_hash(cal.data);
}

// A solve under a robust loss that bad corners do not bend, so that the marks of the first round can be
// trusted.
void robust_solve(Calibration& cal, const RefineOptions& options, const Constraints& constraints) {
  for (int round = 0; round < 2; ++round) {
    Calibration trial = cal;
    if (options.mark_outliers) mark_gross(trial, options);
    const double scale = robust_scale_px(cal);
    const SolveSpec spec = with_constraints({.loss = Loss::kCauchy,
                                             .loss_scale = scale,
                                             .use_sigma = false,
                                             .max_iterations = std::min(60, options.max_iterations),
                                             .tight = false,
                                             .prior_weight = scale / 3,
                                             .solver = options.solver,
                                             .n_threads = options.n_threads},
                                            constraints);
    if (!solve(trial, spec).usable) return;
    cal = std::move(trial);
    bring_back(cal);
  }
}

// Corners and priors weigh by their own scatter, and the corners' is known after a solve only. Whether that
// changes the weight of the priors.
bool weigh_priors(const Calibration& cal, SolveSpec& spec) {
  constexpr double kLeastPx = 1e-4, kSame = 1e-6;  // data without noise would leave the priors no weight
  if (spec.priors.empty()) return false;
  const double noise = std::max(kLeastPx, std::sqrt(residual_variance(cal, spec)));
  const bool changed = std::abs(noise - spec.prior_weight) > kSame * noise;
  spec.prior_weight = noise;
  return changed;
}

// Solves, marks outliers, and solves again until no mark changes.
Result<SolveReport> solve_and_mark(Calibration& cal, const RefineOptions& options, SolveSpec& spec) {
  constexpr int kWeighingRounds = 20;
  SolveReport report;
  int iterations = 0, n_weighings = 0;
  for (int round = 0; round < kMarkingRounds;) {
    report = solve(cal, spec);
    iterations += report.iterations;
    report.iterations = iterations;
    if (!report.usable) {
      return Error{ErrorCode::kNotConverged, "the joint solve found no finite optimum: " + report.termination,
                   ""};
    }
    const bool last = !options.mark_outliers || round + 1 == kMarkingRounds;
    if (last)
      evaluate(cal);  // the marks stay those of the solve
    else if (mark_outliers(cal, options)) {
      ++round;
      continue;
    }
    if (n_weighings++ == kWeighingRounds || !weigh_priors(cal, spec)) break;
  }
  return report;
}

Result<Calibration> finish(Calibration cal, const RefineOptions& options, Constraints constraints,
                           bool from_seed) {
  constraints.held = hold_loose_boards(cal, std::move(constraints.held));
  apply(cal, constraints);
  bring_back(cal);
  if (options.mark_outliers || from_seed) robust_solve(cal, options, constraints);
  // A robust loss has bent the tails already.
  const bool cuts_tails = options.mark_outliers && options.loss == Loss::kSquared;
  SolveSpec spec =
      with_constraints({.loss = options.loss,
                        .loss_scale = options.loss_scale_px,
                        .use_sigma = options.use_sigma,
                        .max_iterations = options.max_iterations,
                        .tight = true,
                        .prior_weight = robust_scale_px(cal) / 3,
                        .variance_kept = cuts_tails ? truncated_variance(options.outlier_sigma) : 1.0,
                        .solver = options.solver,
                        .n_threads = options.n_threads},
                       constraints);
  if (auto status = check_ties_beside_spline(cal, spec); !status) return status.error();
  if (options.mark_outliers)
    mark_outliers(cal, options);
  else if (auto error = unprojectable(cal))
    return *error;
  auto report = solve_and_mark(cal, options, spec);
  if (!report) return report.error();
  if (auto status = still_together(cal, constraints); !status) return status.error();
  const std::vector<MonotonicNote> notes = keep_monotonic(cal, spec, *report);
  if (!notes.empty()) evaluate(cal);
  fill_stats(cal, *report);
  cal.stats.priors = prior_pulls(cal, spec.priors);
  if (auto status = judge_determination(cal, spec); !status) return status.error();
  fill_provenance(cal, options);
  add_notes(cal, notes);
  return cal;
}

Result<Calibration> finish_with_effects(Calibration start, const RefineOptions& options, bool from_seed) {
  const Finish solve_all = [&](Calibration cal) -> Result<Calibration> {
    auto constraints = constraints_of(cal, options);
    if (!constraints) return constraints.error();
    hold_cores(cal.rig, constraints->held);
    if (!has_clocks(cal)) return finish(std::move(cal), options, *std::move(constraints), from_seed);
    if (auto status = check_moving(cal, options); !status) return status.error();
    drop_motionless(cal);
    auto moving = finish(std::move(cal), options, *std::move(constraints), from_seed);
    if (!moving) return moving;
    if (auto status = check_smoothness(*moving); !status) return status.error();
    return moving;
  };
  auto plain = solve_all(start);
  if (!plain) return plain;
  return choose_effects(start, *std::move(plain), options, solve_all);
}

Status check_lens_count(const Dataset& data, const std::vector<std::string>& names) {
  if (names.size() == 1 || names.size() == data.cameras.size()) return {};
  return Error{ErrorCode::kInvalidData,
               fmt::format("{} lenses for {} cameras; give one for all, or one each", names.size(),
                           data.cameras.size()),
               "options"};
}

Result<std::vector<Lens>> starting_lenses(const Dataset& data, const std::vector<std::string>& names) {
  if (auto status = check_lens_count(data, names); !status) return status.error();
  std::vector<Lens> lenses;
  for (std::size_t i = 0; i < data.cameras.size(); ++i) {
    const ImageSize size = data.cameras[i].size;
    auto lens = make_lens(names[names.size() == 1 ? 0 : i], size, size.width);
    if (!lens) return lens.error();
    lenses.push_back(*lens);
  }
  return lenses;
}

// What the seed says of a lens that is too simple, first: it makes the other warnings moot.
void add_lean(Calibration& cal, std::vector<WeakDirection> lean) {
  const std::vector<std::string> names = shared_parameter_names(cal);
  for (WeakDirection& weak : lean) {
    const auto i = std::find(names.begin(), names.end(), weak.parameters) - names.begin();
    weak.sigma = std::sqrt((*cal.covariance)(i, i));
  }
  cal.stats.weak.insert(cal.stats.weak.begin(), lean.begin(), lean.end());
}

// \param fits  of each camera alone, which then need no seed; may be empty
Result<Calibration> calibrate_with(const Dataset& data, const RefineOptions& options,
                                   const std::vector<std::optional<Calibration>>& fits) {
  const auto lenses = starting_lenses(data, options.lenses);
  if (!lenses) return lenses.error();
  const bool all_planar = std::all_of(data.targets.begin(), data.targets.end(),
                                      [](const Target& target) { return target.is_planar; });
  if (options.start == Start::kDlt && all_planar) {
    return Error{ErrorCode::kDegenerate,
                 "a camera matrix by DLT needs points that are not in one plane, and all points of this "
                 "target are; use "
                 "--start zhang",
                 "target " + data.targets[0].name};
  }
  Calibration empty = empty_calibration(data, *lenses);
  if (auto status = add_wanted_effects(empty, options); !status) return status.error();
  const auto constraints = constraints_of(empty, options);
  if (!constraints) return constraints.error();
  if (auto status = enough_views(empty, *constraints); !status) return status.error();
  if (auto status = check_held_without_start(empty, *constraints, options); !status) return status.error();

  // Suspects take no part in the start; from there on residuals judge them like all others.
  const bool all_fitted =
      !fits.empty() && std::all_of(fits.begin(), fits.end(), [](const auto& f) { return f.has_value(); });
  const Dataset sound =
      options.mark_outliers && !all_fitted ? without_suspects(data, options.n_threads) : data;
  std::vector<MonoData> parts;
  std::vector<Calibration> monos;
  std::vector<WeakDirection> lean;
  int offset = 0;
  for (std::size_t cam = 0; cam < data.cameras.size(); ++cam) {
    const bool has_fit = cam < fits.size() && fits[cam];
    parts.push_back(mono_data(has_fit ? data : sound, static_cast<int>(cam)));
    const Constraints of_camera = slice(*constraints, offset, n_params((*lenses)[cam]));
    offset += n_params((*lenses)[cam]);
    if (has_fit) {
      monos.push_back(*fits[cam]);
      continue;
    }
    auto mono = seed_camera(parts[cam].data, options.lenses[options.lenses.size() == 1 ? 0 : cam], options,
                            of_camera);
    if (!mono) return mono.error();
    lean.insert(lean.end(), mono->stats.weak.begin(), mono->stats.weak.end());
    monos.push_back(*std::move(mono));
  }
  auto seed = seed_rig(data, parts, std::move(monos));
  if (!seed) return seed.error();
  refuse_small_views(*seed);
  seed->bow_m = empty.bow_m;
  seed->clocks = empty.clocks;
  // Anew: the seed may have chosen the shape of a lens.
  const auto constraints_of_seed = constraints_of(*seed, options);
  if (!constraints_of_seed) return constraints_of_seed.error();
  if (auto status = enough_views(*seed, *constraints_of_seed); !status) return status.error();
  auto cal = finish_with_effects(*std::move(seed), options, true);
  if (cal && cal->covariance) add_lean(*cal, lean);
  return cal;
}

Result<Calibration> calibrate_chosen(const Dataset& data, const RefineOptions& options) {
  if (auto status = check_lens_count(data, options.lenses); !status) return status.error();
  auto chosen = choose_with_fits(data, options, {});
  if (!chosen) return chosen.error();
  RefineOptions with = options;
  with.lenses = chosen->choice.lenses;
  auto cal = calibrate_with(data, with, chosen->fits);
  if (!cal) return cal;
  cal->provenance.lens_tries = std::move(chosen->choice.tries);
  cal->provenance.options["lens_choice"] = "auto";
  return cal;
}

}  // namespace

Result<Calibration> calibrate(const Dataset& data, const RefineOptions& options) {
  if (auto status = check_options(options); !status) return status.error();
  if (auto status = validate(data); !status) return status.error();
  const bool choose = std::find(options.lenses.begin(), options.lenses.end(), "auto") != options.lenses.end();
  return choose ? calibrate_chosen(data, options) : calibrate_with(data, options, {});
}

Result<Calibration> refine(const Calibration& start, const RefineOptions& options) {
  if (auto status = check_options(options); !status) return status.error();
  if (auto status = validate(start.data); !status) return status.error();
  PLUMBLINE_CHECK(start.rig.cameras.size() == start.data.cameras.size() &&
                      start.rig.T_cam_rig.size() == start.rig.cameras.size() &&
                      start.T_rig_board.size() == start.data.frames.size() &&
                      start.T_board0_board.size() == start.data.targets.size() &&
                      start.bow_m.size() <= start.data.targets.size() &&
                      (start.clocks.empty() || start.clocks.size() == start.rig.cameras.size()),
                  "rig, poses and data of a start belong together");
  Calibration cal = start;
  if (auto status = add_wanted_effects(cal, options); !status) return status.error();
  const auto constraints = constraints_of(cal, options);
  if (!constraints) return constraints.error();
  cal.fits.assign(cal.data.views.size(), {});
  cal.view_reason.assign(cal.data.views.size(), "");
  cal.covariance.reset();
  for (std::size_t v = 0; v < cal.data.views.size(); ++v)
    cal.fits[v].resize(cal.data.views[v].corners.size());
  refuse_small_views(cal);
  if (auto status = enough_views(cal, *constraints); !status) return status.error();
  auto done = finish_with_effects(std::move(cal), options, false);
  if (done) done->provenance.options["start"] = "given";
  return done;
}

}  // namespace plumbline
