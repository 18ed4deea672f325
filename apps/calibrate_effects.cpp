// SPDX-License-Identifier: Apache-2.0
#include "calibrate_effects.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <map>

#include "plumbline/core/text.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/rig/effects.hpp"

namespace plumbline::apps {
namespace {

// A time as whole seconds and the rest: epochs in seconds leave a double a quarter of a microsecond.
struct Time {
  std::int64_t whole_s = 0;
  double rest_s = 0;
};

std::optional<std::int64_t> whole_number(std::string_view text) {
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || text.empty()) return std::nullopt;
  return value;
}

std::optional<Time> time_of_seconds(std::string_view text) {
  const std::size_t point = text.find('.');
  if (const auto whole = whole_number(text.substr(0, point)); whole && *whole >= 0) {
    const auto rest = point == std::string_view::npos ? std::optional(0.0)
                                                      : parse_double("0" + std::string(text.substr(point)));
    if (rest) return Time{*whole, *rest};
  }
  if (const auto value = parse_double(text)) return Time{0, *value};
  return std::nullopt;
}

std::optional<Time> time_of_name(const std::string& image) {
  const auto ns = whole_number(std::filesystem::path(image).stem().string());
  if (!ns || *ns < 0) return std::nullopt;
  constexpr std::int64_t kBillion = 1'000'000'000;
  return Time{*ns / kBillion, static_cast<double>(*ns % kBillion) * 1e-9};
}

Result<std::map<std::string, Time>> read_times(const std::string& file) {
  const auto text = read_file(file);
  if (!text) return text.error();
  std::map<std::string, Time> times;
  int number = 0;
  for (const std::string& line : split(*text, '\n')) {
    ++number;
    const std::string_view row = trim(line);
    if (row.empty() || row.front() == '#') continue;
    const std::size_t comma = row.rfind(',');
    const auto time =
        comma == std::string_view::npos ? std::nullopt : time_of_seconds(trim(row.substr(comma + 1)));
    if (!time) {
      if (times.empty() && row.find("time") != std::string_view::npos) continue;  // the heading
      return Error{ErrorCode::kParse, "'image,time_s' is needed", fmt::format("{}, line {}", file, number)};
    }
    const std::string image(trim(row.substr(0, comma)));
    if (!times.emplace(image, *time).second)
      return Error{ErrorCode::kInvalidData, fmt::format("image {} is there twice", image), file};
  }
  return times;
}

}  // namespace

void add_effect_options(CLI::App& app, EffectArgs& args) {
  app.add_option(
         "--refine", args.refine,
         "estimate these too: bow (of flat boards), line-delay (rolling shutter), time-offset (between "
         "cameras), or auto: each that is significant; several separated by commas")
      ->delimiter(',')
      ->check(CLI::IsMember({"bow", "line-delay", "time-offset", "auto"}));
}

void set_effects(const EffectArgs& args, RefineOptions& options) {
  const auto has = [&](const char* word) {
    return std::find(args.refine.begin(), args.refine.end(), word) != args.refine.end();
  };
  const Estimate otherwise = has("auto") ? Estimate::kAuto : Estimate::kNo;
  options.bow = has("bow") ? Estimate::kYes : otherwise;
  options.line_delay = has("line-delay") ? Estimate::kYes : otherwise;
  options.time_offset = has("time-offset") ? Estimate::kYes : otherwise;
}

Status add_times(const std::string& times, Dataset& data) {
  if (times.empty()) return {};
  std::map<std::string, Time> of_image;
  if (times == "names") {
    for (const View& view : data.views) {
      const auto time = time_of_name(view.image);
      if (!time) {
        return Error{ErrorCode::kInvalidData,
                     "--times names needs file names that are whole numbers of nanoseconds",
                     "image " + view.image};
      }
      of_image[view.image] = *time;
    }
  } else {
    auto listed = read_times(times);
    if (!listed) return listed.error();
    for (const View& view : data.views) {
      auto found = listed->find(view.image);
      if (found == listed->end()) found = listed->find(std::filesystem::path(view.image).filename().string());
      if (found == listed->end())
        return Error{ErrorCode::kInvalidData, "it has no time for image " + view.image, times};
      of_image[view.image] = found->second;
    }
  }
  std::int64_t first_s = std::numeric_limits<std::int64_t>::max();
  for (const auto& [image, time] : of_image) first_s = std::min(first_s, time.whole_s);
  for (View& view : data.views) {
    const Time& time = of_image[view.image];
    view.time_s = static_cast<double>(time.whole_s - first_s) + time.rest_s;
  }
  return {};
}

void add_effects(const Calibration& c, Json& json) {
  const auto values = effect_values(c);
  if (!values.empty()) json["effects"] = Json::array();
  for (const EffectValue& e : values) {
    json["effects"].push_back({{"parameter", e.parameter},
                               {"value", e.value},
                               {"sigma", e.sigma ? Json(*e.sigma) : Json(nullptr)},
                               {"unit", e.unit}});
  }
  if (!c.stats.effects.empty()) json["effects_tried"] = Json::array();
  for (const EffectTry& e : c.stats.effects) {
    json["effects_tried"].push_back({{"effect", e.effect},
                                     {"parameters", e.n_parameters},
                                     {"f", e.f},
                                     {"p_value", e.p_value},
                                     {"bound", e.bound},
                                     {"kept", e.kept},
                                     {"reason", e.reason.empty() ? Json(nullptr) : Json(e.reason)}});
  }
}

std::string text_of_effects(const Calibration& c) {
  std::string text;
  for (const EffectValue& e : effect_values(c)) {
    text += fmt::format("{}: {:.6g}{} {}\n", e.parameter, e.value,
                        e.sigma ? fmt::format(" +- {:.2g}", *e.sigma) : "", e.unit);
  }
  for (const EffectTry& e : c.stats.effects) {
    if (!e.reason.empty()) {
      text += fmt::format("{}: not tried: {}\n", e.effect, e.reason);
      continue;
    }
    text +=
        fmt::format("{}: {} (F = {:.4g}, by chance with probability {:.2g}; kept under {:.2g})\n", e.effect,
                    e.kept ? "significant, kept" : "not significant, left out", e.f, e.p_value, e.bound);
  }
  return text;
}

}  // namespace plumbline::apps
