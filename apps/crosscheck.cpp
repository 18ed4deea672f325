// SPDX-License-Identifier: Apache-2.0
#include "plumbline/crosscheck/crosscheck.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "args.hpp"

namespace plumbline::apps {
namespace {

struct Options {
  std::string calibration;
  double max_diff_px = 0;
};

Json json_of_camera(const CameraCrosscheck& c) {
  return {{"name", c.name},
          {"lens", c.lens},
          {"referee_lens", c.referee_lens},
          {"rms_px", c.rms_px},
          {"referee_rms_px", c.referee_rms_px},
          {"diff_px", {{"rms", c.diff_px.rms}, {"p95", c.diff_px.p95}, {"max", c.diff_px.max}}},
          {"parameters", c.parameters},
          {"referee_parameters", c.referee_parameters}};
}

Result<int> run(const Options& o, const Common& common) {
  auto calibration = load_calibration(o.calibration);
  if (!calibration) return calibration.error();
  auto check = crosscheck_mrcal(*calibration);
  if (!check) return check.error();
  Json json{{"cameras", Json::array()},
            {"joint",
             {{"rms_px", check->rms_px},
              {"referee_rms_px", check->referee_rms_px},
              {"referee_rms_from_seed_px", check->referee_rms_from_seed_px}}},
            {"notes", check->notes}};
  std::string text;
  double worst = 0;
  for (const CameraCrosscheck& c : check->cameras) {
    json["cameras"].push_back(json_of_camera(c));
    text += fmt::format(
        "{} alone: {} rms {:.8f} px, mrcal {} {:.8f} px; projections differ by {:.2g} px rms, {:.2g} px at "
        "most\n",
        c.name, c.lens, c.rms_px, c.referee_lens, c.referee_rms_px, c.diff_px.rms, c.diff_px.max);
    worst = std::max(worst, c.diff_px.max);
  }
  text += fmt::format(
      "all cameras together: rms {:.8f} px, mrcal {:.8f} px from our optimum and {:.8f} px from our seed\n",
      check->rms_px, check->referee_rms_px, check->referee_rms_from_seed_px);
  if (check->bow_m && check->referee_bow_m) {
    const Vec2 ours = *check->bow_m, theirs = *check->referee_bow_m;
    text += fmt::format("bow of the board [m]: ({:.9f}, {:.9f}), mrcal ({:.9f}, {:.9f})\n", ours.x(),
                        ours.y(), theirs.x(), theirs.y());
    json["bow_m"] = {ours.x(), ours.y()};
    json["referee_bow_m"] = {theirs.x(), theirs.y()};
  }
  for (const std::string& note : check->notes) text += note + "\n";
  const bool missed = o.max_diff_px > 0 && !(worst <= o.max_diff_px);
  if (missed)
    text += fmt::format("quality gate missed: {:.6g} px is above --max-diff {} px\n", worst, o.max_diff_px);
  if (Status s = print_result(common, json, text); !s) return s.error();
  return missed ? kGateMissed : kDone;
}

}  // namespace

void add_crosscheck(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  app.add_option("calibration", o->calibration, "calibration.yaml of ours")->required();
  app.add_option("--max-diff", o->max_diff_px,
                 "exit with 3 when a camera's largest difference is above this [px]")
      ->check(positive());
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps
