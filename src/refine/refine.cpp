// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/refine.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plumbline/core/check.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/rig/motion.hpp"
#include "refine/effects.hpp"
#include "refine/outliers.hpp"
#include "refine/recording.hpp"
#include "refine/seed.hpp"
#include "refine/solve.hpp"
#include "refine/weak.hpp"

namespace plumbline {

namespace {

using namespace detail;

constexpr int kMarkingRounds = 5;
constexpr std::size_t kLeastCorners = 4;  // a pose has six unknowns, a planar one needs four points

Status check_options(const RefineOptions& options) {
  const auto bad = [](std::string message) {
    return Error{ErrorCode::kInvalidData, std::move(message), "options"};
  };
  if (!(options.loss_scale_px > 0))
    return bad(fmt::format("loss scale {} px is not positive", options.loss_scale_px));
  if (!(options.outlier_sigma > 0))
    return bad(fmt::format("outlier sigma {} is not positive", options.outlier_sigma));
  if (options.max_iterations < 1) return bad(fmt::format("{} iterations", options.max_iterations));
  return {};
}

const char* name_of(Loss loss) {
  return loss == Loss::kSquared ? "squared" : loss == Loss::kHuber ? "huber" : "cauchy";
}
const char* name_of(Start start) {
  return start == Start::kAuto ? "auto" : start == Start::kZhang ? "zhang" : "dlt";
}

void fill_stats(Calibration& cal, const SolveReport& report, int iterations) {
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
  stats.iterations = iterations;
  stats.converged = report.converged;
  stats.termination = report.termination;
  cal.stats = stats;
}

void fill_provenance(Calibration& cal, const RefineOptions& options) {
  std::vector<std::string> lenses;
  for (const Camera& camera : cal.rig.cameras) lenses.emplace_back(lens_name(camera.lens));
  auto& o = cal.provenance.options;
  o["lens"] = join(lenses, ",");
  o["start"] = name_of(options.start);
  o["loss"] = name_of(options.loss);
  if (options.loss != Loss::kSquared) o["loss_scale_px"] = format_double(options.loss_scale_px);
  o["outliers"] =
      options.mark_outliers ? "marked beyond " + format_double(options.outlier_sigma) + " sigma" : "kept";
  o["fixed"] = join(options.fixed, ",");
  o["sigma"] = options.use_sigma ? "used" : "not used";
  for (const auto& [name, estimate] : {std::pair{"bow", options.bow},
                                       {"line_delay", options.line_delay},
                                       {"time_offset", options.time_offset}}) {
    if (estimate != Estimate::kNo) o[name] = estimate == Estimate::kYes ? "estimated" : "auto";
  }
  o["max_iterations"] = std::to_string(options.max_iterations);
  cal.provenance.corners_hash = corners_hash(cal.data);
}

// Why a view that has corners cannot take part, or nothing.
void refuse_small_views(Calibration& cal) {
  const std::size_t least = kLeastCorners;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    const View& view = cal.data.views[v];
    if (view.corners.empty()) {
      cal.fits[v].clear();
      cal.view_reason[v] = view.reason.empty() ? "no corners" : view.reason;
    } else if (view.corners.size() < least) {
      cal.fits[v].clear();
      cal.view_reason[v] = fmt::format("{} corners, at least {} are needed", view.corners.size(), least);
    } else if (!cal.T_rig_board[view.frame]) {
      cal.fits[v].clear();
      if (cal.view_reason[v].empty()) cal.view_reason[v] = "its frame has no board pose";
    }
  }
}

// First corner that takes part and does not project.
std::optional<Error> unprojectable(const Calibration& cal) {
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    if (!takes_part(cal, v)) continue;
    const View& view = cal.data.views[v];
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      if (!cal.fits[v][i].outlier) continue;
      const Camera& camera = cal.rig.cameras[view.cam];
      return Error{
          ErrorCode::kNotConverged,
          fmt::format(
              "point {} lies outside the domain of lens {} at the start; leave outlier marking on, or "
              "choose a lens for a wider view",
              view.corners[i].point, lens_name(camera.lens)),
          fmt::format("camera {}, view {}", camera.name, view.image)};
    }
  }
  return std::nullopt;
}

// A solve under a robust loss that bad corners do not bend, so that the marks of the first round can be
// trusted.
void robust_solve(Calibration& cal, const RefineOptions& options, const std::vector<bool>& held) {
  for (int round = 0; round < 2; ++round) {
    Calibration trial = cal;
    const SolveSpec spec{.loss = Loss::kCauchy,
                         .loss_scale = robust_scale_px(cal),
                         .use_sigma = false,
                         .max_iterations = std::min(60, options.max_iterations),
                         .tight = false,
                         .held = held,
                         .solver = options.solver,
                         .n_threads = options.n_threads};
    if (!solve(trial, spec).usable) return;
    cal = std::move(trial);
    bring_back(cal);
  }
}

Result<Calibration> finish(Calibration cal, const RefineOptions& options, const std::vector<bool>& held,
                           bool from_seed) {
  bring_back(cal);
  if (options.mark_outliers || from_seed) robust_solve(cal, options, held);
  const SolveSpec spec{.loss = options.loss,
                       .loss_scale = options.loss_scale_px,
                       .use_sigma = options.use_sigma,
                       .max_iterations = options.max_iterations,
                       .tight = true,
                       .held = held,
                       .solver = options.solver,
                       .n_threads = options.n_threads};
  SolveReport report;
  int iterations = 0;
  if (options.mark_outliers)
    mark_outliers(cal, options);
  else if (auto error = unprojectable(cal))
    return *error;
  for (int round = 0; round < kMarkingRounds; ++round) {
    report = solve(cal, spec);
    iterations += report.iterations;
    if (!report.usable) {
      return Error{ErrorCode::kNotConverged, "the joint solve found no finite optimum: " + report.termination,
                   ""};
    }
    if (!options.mark_outliers) {
      evaluate(cal);
      break;
    }
    // The marks of the last round stay those of its solve.
    if (round + 1 == kMarkingRounds) {
      evaluate(cal);
      break;
    }
    if (!mark_outliers(cal, options)) break;
  }
  fill_stats(cal, report, iterations);
  if (auto status = judge_determination(cal, spec); !status) return status.error();
  fill_provenance(cal, options);
  return cal;
}

Result<Calibration> finish_with_effects(Calibration start, const RefineOptions& options, bool from_seed) {
  const Finish solve_all = [&](Calibration cal) -> Result<Calibration> {
    const auto held = held_mask(cal, options.fixed);
    if (!held) return held.error();
    if (!has_clocks(cal)) return finish(std::move(cal), options, *held, from_seed);
    drop_motionless(cal);
    auto moving = finish(std::move(cal), options, *held, from_seed);
    if (!moving) return moving;
    if (auto status = check_smoothness(*moving); !status) return status.error();
    return moving;
  };
  auto plain = solve_all(start);
  if (!plain) return plain;
  return choose_effects(start, *std::move(plain), options, solve_all);
}

// Enough views to constrain a lens? Planar: three (Zhang 2000); points in space: one.
Status enough_views(const Calibration& cal) {
  for (std::size_t cam = 0; cam < cal.rig.cameras.size(); ++cam) {
    const bool some_planar = std::any_of(cal.data.targets.begin(), cal.data.targets.end(),
                                         [](const Target& target) { return target.is_planar; });
    int n = 0, needed = some_planar ? 3 : 1;
    for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
      const View& view = cal.data.views[v];
      if (view.cam != static_cast<int>(cam) || view.corners.size() < kLeastCorners ||
          !cal.view_reason[v].empty())
        continue;
      ++n;
      if (!cal.data.targets[view.target].is_planar) needed = 1;
    }
    if (n >= needed) continue;
    return Error{
        ErrorCode::kDegenerate,
        fmt::format(
            "{} usable view{} of the board, at least {} are needed; add images that show the board tilted "
            "in several directions",
            n, n == 1 ? "" : "s", needed),
        "camera " + cal.rig.cameras[cam].name};
  }
  return {};
}

Result<std::vector<Lens>> starting_lenses(const Dataset& data, const std::vector<std::string>& names) {
  if (names.size() != 1 && names.size() != data.cameras.size()) {
    return Error{ErrorCode::kInvalidData,
                 fmt::format("{} lenses for {} cameras; give one for all, or one each", names.size(),
                             data.cameras.size()),
                 "options"};
  }
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

}  // namespace

Result<Calibration> calibrate(const Dataset& data, const RefineOptions& options) {
  if (auto status = check_options(options); !status) return status.error();
  if (auto status = validate(data); !status) return status.error();
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
  const auto held = held_mask(empty, options.fixed);
  if (!held) return held.error();
  if (auto status = enough_views(empty); !status) return status.error();

  std::vector<MonoData> parts;
  std::vector<Calibration> monos;
  std::vector<WeakDirection> lean;
  std::size_t offset = 0;
  for (std::size_t cam = 0; cam < data.cameras.size(); ++cam) {
    parts.push_back(mono_data(data, static_cast<int>(cam)));
    const auto n = static_cast<std::size_t>(n_params((*lenses)[cam]));
    const std::vector<bool> held_mono(held->begin() + offset, held->begin() + offset + n);
    offset += n;
    auto mono = seed_camera(parts[cam].data, std::string(lens_name((*lenses)[cam])), options, held_mono);
    if (!mono) return mono.error();
    lean.insert(lean.end(), mono->stats.weak.begin(), mono->stats.weak.end());
    monos.push_back(*std::move(mono));
  }
  auto seed = seed_rig(data, parts, std::move(monos));
  if (!seed) return seed.error();
  refuse_small_views(*seed);
  if (auto status = enough_views(*seed); !status) return status.error();
  seed->bow_m = empty.bow_m;
  seed->clocks = empty.clocks;
  auto cal = finish_with_effects(*std::move(seed), options, true);
  if (cal) add_lean(*cal, lean);
  return cal;
}

Result<Calibration> refine(const Calibration& start, const RefineOptions& options) {
  if (auto status = check_options(options); !status) return status.error();
  if (auto status = validate(start.data); !status) return status.error();
  PLUMBLINE_CHECK(start.rig.cameras.size() == start.data.cameras.size() &&
                      start.rig.T_cam_rig.size() == start.rig.cameras.size() &&
                      start.T_rig_board.size() == start.data.frames.size() &&
                      start.T_board0_board.size() == start.data.targets.size(),
                  "rig, poses and data of a start belong together");
  Calibration cal = start;
  if (auto status = add_wanted_effects(cal, options); !status) return status.error();
  cal.fits.assign(cal.data.views.size(), {});
  cal.view_reason.assign(cal.data.views.size(), "");
  cal.covariance.reset();
  for (std::size_t v = 0; v < cal.data.views.size(); ++v)
    cal.fits[v].resize(cal.data.views[v].corners.size());
  refuse_small_views(cal);
  if (auto status = enough_views(cal); !status) return status.error();
  return finish_with_effects(std::move(cal), options, false);
}

}  // namespace plumbline
