// SPDX-License-Identifier: Apache-2.0
#include "io/effects_yaml.hpp"

#include <fmt/format.h>

#include <iterator>

#include "plumbline/core/text.hpp"
#include "plumbline/rig/effects.hpp"

namespace plumbline::io {
namespace {

// Standard deviations are for the reader's eye: they are those of the covariance, which is read back.
constexpr const char* kSigma = "sigma_";

void write_group(std::string& out, const char* key, const std::vector<EffectValue>& values,
                 const std::vector<std::pair<std::string, std::string>>& renamed) {
  std::string last, text;
  for (const EffectValue& value : values) {
    const std::size_t space = value.parameter.rfind(' ');
    const std::string owner = value.parameter.substr(0, space), name = value.parameter.substr(space + 1);
    for (const auto& [parameter, as] : renamed) {
      if (parameter != name) continue;
      if (owner != last || text.empty()) text += fmt::format("  {}:\n", yaml_text(owner));
      last = owner;
      text += fmt::format("    {}: {}\n", as, number_text(value.value));
      if (value.sigma) text += fmt::format("    {}{}: {}\n", kSigma, as, number_text(*value.sigma));
    }
  }
  if (!text.empty()) out += fmt::format("{}:\n{}", key, text);
}

}  // namespace

void write_effect_values(std::string& out, const Calibration& calibration) {
  const std::vector<EffectValue> values = effect_values(calibration);
  write_group(out, "board_bow", values, {{"bow_x", "x_m"}, {"bow_y", "y_m"}});
  write_group(out, "clocks", values, {{"line_delay", "line_delay_s"}, {"time_offset", "time_offset_s"}});
}

void read_effect_values(const Field& root, Calibration& calibration) {
  const auto index = [](const auto& list, const std::string& name, const Field& field) {
    for (std::size_t i = 0; i < list.size(); ++i) {
      if (list[i].name == name) return i;
    }
    field.fail(fmt::format("there is no '{}'", name.substr(0, 80)));
  };
  if (const auto bows = root.find("board_bow")) {
    calibration.bow_m.resize(calibration.data.targets.size());
    for (const auto& [name, bow] : bows->entries()) {
      bow.only({"x_m", "y_m", "sigma_x_m", "sigma_y_m"});
      const std::size_t i = index(calibration.data.targets, name, bow);
      if (!calibration.data.targets[i].outline) bow.fail("this target is not flat and has no bow");
      calibration.bow_m[i] = Vec2(bow.at("x_m").number(), bow.at("y_m").number());
    }
  }
  if (const auto clocks = root.find("clocks")) {
    calibration.clocks.resize(calibration.rig.cameras.size());
    for (const auto& [name, clock] : clocks->entries()) {
      clock.only({"line_delay_s", "time_offset_s", "sigma_line_delay_s", "sigma_time_offset_s"});
      CameraClock& out = calibration.clocks[index(calibration.rig.cameras, name, clock)];
      if (const auto delay = clock.find("line_delay_s")) out.line_delay_s = delay->number();
      if (const auto offset = clock.find("time_offset_s")) out.time_offset_s = offset->number();
    }
  }
}

void write_effect_tries(std::string& out, const std::vector<EffectTry>& effects) {
  if (!effects.empty()) out += "  effects:\n";
  for (const EffectTry& e : effects) {
    out += fmt::format(
        "    - effect: {}\n      parameters: {}\n      f: {}\n      p_value: {}\n      bound: {}\n",
        yaml_text(e.effect), e.n_parameters, number_text(e.f), number_text(e.p_value), number_text(e.bound));
    out += fmt::format("      kept: {}\n", e.kept ? "true" : "false");
    if (!e.reason.empty()) out += fmt::format("      reason: {}\n", yaml_text(e.reason));
  }
}

std::vector<EffectTry> read_effect_tries(const Field& summary) {
  std::vector<EffectTry> effects;
  const auto list = summary.find("effects");
  if (!list) return effects;
  for (const Field& item : list->items()) {
    item.only({"effect", "parameters", "f", "p_value", "bound", "kept", "reason"});
    EffectTry e;
    e.effect = item.at("effect").text();
    e.n_parameters = item.at("parameters").integer(1, 2);
    e.f = item.at("f").number();
    e.p_value = item.at("p_value").number();
    e.bound = item.at("bound").number();
    e.kept = item.at("kept").boolean();
    if (const auto reason = item.find("reason")) e.reason = reason->text();
    effects.push_back(std::move(e));
  }
  return effects;
}

}  // namespace plumbline::io
