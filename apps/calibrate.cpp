// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <chrono>

#include "args.hpp"
#include "calibrate_effects.hpp"
#include "calibrate_inputs.hpp"
#include "calibrate_look.hpp"
#include "calibrate_report.hpp"
#include "calibrate_start.hpp"
#include "plumbline/io/calibration_io.hpp"
#include "plumbline/io/dataset_io.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/refine/refine.hpp"

namespace plumbline::apps {
namespace {

struct Options {
  CalibrateInputs inputs;
  CalibrateStart start;
  std::string output;
  std::string lens, loss = "squared", outliers = "auto";
  double loss_scale_px = 1.0, outlier_sigma = 5.0, max_rms_px = 0;
  bool use_sigma = false, no_second_look = false;
  EffectArgs effects;
};

RefineOptions refine_options(const Options& o, const Common& common) {
  RefineOptions options;
  fill_options(o.start, options);
  options.loss = o.loss == "huber" ? Loss::kHuber : o.loss == "cauchy" ? Loss::kCauchy : Loss::kSquared;
  options.loss_scale_px = o.loss_scale_px;
  options.mark_outliers = o.outliers != "off";
  options.outlier_sigma = o.outlier_sigma;
  options.use_sigma = o.use_sigma;
  options.n_threads = common.n_threads;
  set_effects(o.effects, options);
  return options;
}

Result<int> run(const Options& o, const Common& common) {
  using Clock = std::chrono::steady_clock;
  const auto seconds_since = [](Clock::time_point t) {
    return std::chrono::duration<double>(Clock::now() - t).count();
  };
  check_usage(o.start, o.inputs);
  RefineOptions options = refine_options(o, common);
  if (Status s = check_output(o.output, common); !s) return s.error();
  const auto start = Clock::now();
  const auto problem = load_problem(o.start, o.inputs, o.lens, common);
  if (!problem) return problem.error();
  const double detect_s = seconds_since(start);
  if (!problem->start) {
    auto lenses = parse_lenses(o.lens.empty() ? "opencv5" : o.lens, problem->data.cameras, false);
    if (!lenses) return lenses.error();
    options.lenses = *lenses;
  }

  const auto solve_start = Clock::now();
  auto calibration = problem->start ? refine(*problem->start, options) : calibrate(problem->data, options);
  if (!calibration) return calibration.error();
  std::optional<LookReport> look;
  if (!o.no_second_look && can_look_again(o.inputs, !o.start.earlier.empty())) {
    auto report =
        look_and_solve(problem->observed.images, options, problem->start.has_value(), common, *calibration);
    if (!report) return report.error();
    look = *std::move(report);
  }
  const double look_s = look ? look->seconds : 0, solve_s = seconds_since(solve_start) - look_s;
  calibration->provenance.version = PLUMBLINE_VERSION;

  const Status written =
      write_folder(o.output, common.force, [&](const std::filesystem::path& folder) -> Status {
        if (Status s = write_file(folder / "calibration.yaml", format_calibration(*calibration), true); !s)
          return s;
        return write_file(folder / "corners.yaml", format_corners(calibration->data), true);
      });
  if (!written) return written.error();

  Json json = json_of_calibration(*calibration);
  json["notes"] = problem->observed.notes;
  if (look) add_look(*look, *calibration, json);
  json["seconds"] = {
      {"detect", detect_s}, {"second_look", look_s}, {"solve", solve_s}, {"all", seconds_since(start)}};
  std::string text = text_of_notes(problem->observed.notes) + text_of_calibration(*calibration);
  if (look) text += text_of_look(*look, *calibration);
  text += fmt::format("written: {0}/calibration.yaml, {0}/corners.yaml\n", o.output);
  const bool missed = o.max_rms_px > 0 && !(calibration->stats.rms_px <= o.max_rms_px);
  if (missed)
    text += fmt::format("quality gate missed: rms {:.4f} px is above --max-rms {} px\n",
                        calibration->stats.rms_px, o.max_rms_px);
  for (const WeakDirection& w : calibration->stats.weak) {
    fmt::print(stderr, "plumbline calibrate: WEAK: {}: {}\n", w.parameters, w.consequence);
  }
  if (Status s = print_result(common, json, text); !s) return s.error();
  return missed ? kGateMissed : kDone;
}

}  // namespace

void add_calibrate(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  add_input_options(app, o->inputs);
  add_start_options(app, o->start);
  app.add_option(
      "--lens", o->lens,
      "one lens for all cameras, or left=opencv8,right=kb4; auto: the one that predicts views left out best "
      "(default: opencv5; with a start, those of the start, also for cameras that are not named)");
  app.add_option("--loss", o->loss, "squared, huber or cauchy")
      ->check(CLI::IsMember({"squared", "huber", "cauchy"}));
  app.add_option("--loss-scale", o->loss_scale_px, "where huber and cauchy bend [px]")->check(positive());
  app.add_option("--outliers", o->outliers, "auto: corners far off are left out; off: all corners are used")
      ->check(CLI::IsMember({"auto", "off"}));
  app.add_option("--outlier-sigma", o->outlier_sigma, "how far off, in robust standard deviations")
      ->check(positive());
  app.add_flag("--use-sigma", o->use_sigma, "weight each corner by its own sigma");
  app.add_flag(
      "--no-second-look", o->no_second_look,
      "with images: use the corners of the first search alone. Else the images are searched again where "
      "the first calibration puts corners that are missing, and centres of circles are freed of their bias");
  add_effect_options(app, o->effects);
  app.add_option("--max-rms", o->max_rms_px, "exit with 3 when the rms is above this [px]")
      ->check(positive());
  app.add_option("-o,--output", o->output, "folder for calibration.yaml and corners.yaml")->required();
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps
