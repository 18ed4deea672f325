// SPDX-License-Identifier: Apache-2.0
#include "calibrate_start.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>

#include "calibrate_effects.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/io/formats.hpp"
#include "plumbline/refine/start.hpp"
#include "plumbline/rig/add_views.hpp"

namespace plumbline::apps {
namespace {

bool is_method(const std::string& start) { return start == "auto" || start == "zhang" || start == "dlt"; }

bool from_files(const CalibrateStart& s) { return !s.start.empty() && !is_method(s.start.front()); }

bool has_inputs(const CalibrateInputs& in) { return !in.corners.empty() || !in.cams.empty(); }

// NAME=VALUE+-SIGMA.
Prior parse_prior(const std::string& text) {
  const std::size_t equals = text.find('='), sign = text.find("+-");
  if (equals != std::string::npos && sign != std::string::npos && equals < sign) {
    const auto value = parse_double(trim(text.substr(equals + 1, sign - equals - 1)));
    const auto sigma = parse_double(trim(text.substr(sign + 2)));
    if (value && sigma) return {std::string(trim(text.substr(0, equals))), *value, *sigma};
  }
  usage_error(fmt::format("--prior {}: it is NAME=VALUE+-SIGMA, such as left.fx=532+-2", text));
}

Result<std::vector<std::string>> lenses_for(const std::string& lens, const std::vector<CameraInfo>& cameras) {
  if (lens.empty()) return std::vector<std::string>{};
  auto lenses = parse_lenses(lens, cameras, true);
  if (lenses && std::find(lenses->begin(), lenses->end(), "auto") != lenses->end())
    usage_error("--lens auto chooses from corners alone; with a start, name the lens or leave --lens away");
  return lenses;
}

// The option that the user typed and its files, in front of what is wrong with them.
Error in_option(Error error, const std::string& option, const std::vector<std::string>& files) {
  std::string named = option;
  for (const std::string& file : files) named += " " + file;
  for (const std::string& file : files) {  // which is named already
    const std::string bare = std::filesystem::path(file).filename().string();
    for (const std::string& prefix : {file, bare}) {
      if (error.where == prefix) error.where.clear();
      if (files.size() == 1 && error.where.starts_with(prefix + ": "))
        error.where.erase(0, prefix.size() + 2);
    }
  }
  error.where = named + (error.where.empty() ? "" : ": " + error.where);
  return error;
}

// Corners given where cameras are wanted.
std::optional<Error> corners_instead(const std::string& file, const std::string& option) {
  if (std::filesystem::is_directory(file)) return std::nullopt;
  const auto text = read_file(file);
  if (!text || text->find("plumbline_corners:") == std::string::npos) return std::nullopt;
  return Error{ErrorCode::kInvalidData, "the file holds corners and no camera; give it as --corners " + file,
               option + file};
}

Result<Calibration> load_earlier(const std::string& file) {
  auto earlier = load_calibration(file);
  if (earlier) {
    if (!earlier->data.views.empty()) return earlier;
    return Error{
        ErrorCode::kInvalidData,
        "the file holds cameras and no corners; give images or corners, and the file as --start " + file,
        file};
  }
  if (auto error = corners_instead(file, "")) return *error;
  const bool is_camera = load_rig({file}).has_value();
  if (!is_camera) return earlier;
  return Error{ErrorCode::kInvalidData,
               "a camera file holds no corners; give images or corners, and the file as --start " + file,
               file};
}

Result<Problem> from_earlier(const CalibrateStart& s, const CalibrateInputs& inputs, const std::string& lens,
                             const Common& common, Observed& observed) {
  auto earlier = load_earlier(s.earlier);
  if (!earlier) return earlier.error();
  if (s.add) {
    CalibrateInputs with_target = inputs;
    with_target.known_targets = earlier->data.targets;
    auto more = load_observations(with_target, common, observed);
    if (!more) return more.error();
    auto added = add_views(*earlier, *more, s.replace);
    if (!added) return in_option(added.error(), s.replace ? "--add --replace to" : "--add to", {s.earlier});
    earlier = *std::move(added);
  } else if (Status status = add_times(inputs.times, earlier->data); !status) {
    return status.error();
  }
  const auto lenses = lenses_for(lens, earlier->data.cameras);
  if (!lenses) return lenses.error();
  StartFrom from{.lenses = *lenses,
                 .T_rig_board = earlier->T_rig_board,
                 .T_board0_board = earlier->T_board0_board,
                 .n_threads = common.n_threads};
  auto start = start_from(earlier->data, earlier->rig, from);
  if (!start) return in_option(start.error(), s.add ? "--add to" : "earlier calibration", {s.earlier});
  start->bow_m = earlier->bow_m;
  start->clocks = earlier->clocks;
  return Problem{start->data, *start, observed};
}

}  // namespace

void add_start_options(CLI::App& app, CalibrateStart& s) {
  app.add_option("earlier", s.earlier,
                 "an earlier calibration.yaml to go on from: its corners are solved again, starting from its "
                 "cameras");
  app.add_flag("--add", s.add, "add the given images or corners to those of the earlier calibration");
  app.add_flag("--replace", s.replace,
               "with --add: images that are there already take the place of the old ones");
  app.add_option(
         "--start", s.start,
         "first estimate: auto, zhang (flat boards), dlt (points that are not coplanar), or camera files "
         "of any known format, whose lenses and places are the start")
      ->allow_extra_args(false);
  const auto list = [&](const char* name, std::vector<std::string>& values, const char* help) {
    app.add_option(name, values, help)->delimiter(',')->allow_extra_args(false);
  };
  list("--fix", s.fixed,
       "hold parameters: k3 (every camera), left.fx, left.fx=532.8 (at that value), or a group: lens, K (fx "
       "fy cx "
       "cy), pose, rig (all places), left (its lens), left.K, left.pose; several separated by commas");
  list("--tie", s.ties,
       "parameters with one value: fx=fy (in each camera), left.fx=right.fx, left=right (lenses)");
  list("--prior", s.priors, "a value known from elsewhere, weighed by its sigma: left.fx=532+-2");
  list("--only", s.only, "solve for these cameras and hold lens and place of all others");
}

void check_usage(const CalibrateStart& s, const CalibrateInputs& inputs) {
  if (s.add && s.earlier.empty()) usage_error("--add needs the earlier calibration.yaml that is added to");
  if (s.replace && !s.add) usage_error("--replace goes with --add");
  for (const std::string& start : s.start) {
    if (is_method(start) && s.start.size() > 1) usage_error("--start is a method or camera files, not both");
    if (!is_method(start) && !std::filesystem::exists(start))
      usage_error(fmt::format("--start {}: neither auto, zhang or dlt nor a file", start));
  }
  if (s.earlier.empty()) {
    check_usage(inputs);
    return;
  }
  if (!s.start.empty()) usage_error("an earlier calibration is the start itself; leave --start away");
  if (s.add && !has_inputs(inputs)) usage_error("--add needs --cam or --corners: what is to be added");
  if (s.add && !inputs.cams.empty() && inputs.corners.empty() && !inputs.image_size.empty())
    usage_error("--image-size goes with a .vnl file; images have their own size");
  if (!s.add && (has_inputs(inputs) || !inputs.targets.empty()))
    usage_error(
        "an earlier calibration and new images: --add joins them; to solve the new ones alone, give the "
        "earlier "
        "file as --start");
  if (!s.add && !inputs.image_size.empty())
    usage_error("--image-size goes with a .vnl file; an earlier calibration has the size of its images");
  if (!s.add && !inputs.pair_by.empty())
    usage_error(
        "--pair-by goes with --add: an earlier calibration has its frames, and only new images are "
        "paired");
}

Result<Problem> load_problem(const CalibrateStart& s, const CalibrateInputs& inputs, const std::string& lens,
                             const Common& common) {
  Observed observed;
  if (!s.earlier.empty()) return from_earlier(s, inputs, lens, common, observed);
  auto data = load_observations(inputs, common, observed);
  if (!data) return data.error();
  if (!from_files(s)) return Problem{*std::move(data), std::nullopt, observed};
  for (const std::string& file : s.start) {
    if (auto error = corners_instead(file, "--start ")) return *error;
  }
  auto rig = load_rig(s.start);
  if (!rig) return in_option(rig.error(), "--start", s.start);
  const auto lenses = lenses_for(lens, data->cameras);
  if (!lenses) return lenses.error();
  auto start = start_from(*data, *rig,
                          {.lenses = *lenses,
                           .places_known = poses_known(*rig),
                           .T_rig_board = {},
                           .T_board0_board = {},
                           .n_threads = common.n_threads});
  if (!start) return in_option(start.error(), "--start", s.start);
  return Problem{*std::move(data), *std::move(start), observed};
}

void fill_options(const CalibrateStart& s, RefineOptions& options) {
  if (!s.start.empty()) {
    options.start = s.start.front() == "zhang" ? Start::kZhang
                    : s.start.front() == "dlt" ? Start::kDlt
                                               : Start::kAuto;
  }
  options.fixed = s.fixed;
  options.ties = s.ties;
  options.only = s.only;
  for (const std::string& text : s.priors) options.priors.push_back(parse_prior(text));
}

}  // namespace plumbline::apps
