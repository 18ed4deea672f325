// SPDX-License-Identifier: Apache-2.0
#include "refine/lens_eligible.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "plumbline/core/text.hpp"
#include "refine/constraints.hpp"
#include "refine/effects.hpp"
#include "refine/parameter_names.hpp"
#include "refine/seed.hpp"

namespace plumbline::detail {
namespace {

// One thing that the options say, alone, and the names in it.
struct Saying {
  RefineOptions alone;
  std::vector<std::string> names;
};

std::vector<Saying> sayings_of(const RefineOptions& options) {
  std::vector<Saying> all;
  const auto add = [&](RefineOptions alone, const std::vector<std::string>& names) {
    Saying& saying = all.emplace_back();
    saying.alone = std::move(alone);
    for (const std::string& name : names) saying.names.emplace_back(trim(name));
  };
  for (const std::string& text : options.fixed) {
    RefineOptions alone;
    alone.fixed = {text};
    add(alone, {text.substr(0, text.find('='))});
  }
  for (const std::string& tie : options.ties) {
    RefineOptions alone;
    alone.ties = {tie};
    add(alone, split(tie, '='));
  }
  for (const Prior& prior : options.priors) {
    RefineOptions alone;
    alone.priors = {prior};
    add(alone, {prior.parameter});
  }
  return all;
}

// Whether a name is of this owner: "left", "left.fx", "left fx".
bool is_of(const std::string& owner, const std::string& name) {
  return name == owner || name.starts_with(owner + ".") || name.starts_with(owner + " ");
}

// Whether a name says something of this camera: its own, or that of no one.
bool concerns(const Dataset& data, int cam, const std::string& name) {
  if (is_of(data.cameras[cam].name, name)) return true;
  const auto names_it = [&](const auto& owner) { return is_of(owner.name, name); };
  return std::none_of(data.cameras.begin(), data.cameras.end(), names_it) &&
         std::none_of(data.targets.begin(), data.targets.end(), names_it);
}

// Nothing when a lens is unknown or an effect impossible, which others say.
std::optional<Calibration> rig_of(const Dataset& data, const RefineOptions& options,
                                  const std::vector<std::string>& names) {
  std::vector<Lens> lenses;
  for (std::size_t i = 0; i < data.cameras.size(); ++i) {
    const auto lens = make_lens(names[i], data.cameras[i].size, data.cameras[i].size.width);
    if (!lens) return std::nullopt;
    lenses.push_back(*lens);
  }
  Calibration rig = empty_calibration(data, lenses);
  if (!add_wanted_effects(rig, options)) return std::nullopt;
  return rig;
}

}  // namespace

std::optional<Ineligible> ineligible(const Dataset& data, const RefineOptions& options, int cam,
                                     const std::string& lens) {
  std::vector<std::string> lenses;
  for (std::size_t i = 0; i < data.cameras.size(); ++i) {
    const std::string& wanted = options.lenses[options.lenses.size() == 1 ? 0 : i];
    lenses.push_back(wanted == "auto" ? lens : wanted);
  }
  const auto rig = rig_of(data, options, lenses);
  if (!rig) return std::nullopt;
  const ParameterNames names(*rig);
  for (const Saying& saying : sayings_of(options)) {
    const auto says = [&](const std::string& name) { return concerns(data, cam, name); };
    if (std::none_of(saying.names.begin(), saying.names.end(), says)) continue;
    const auto constraints = constraints_of(*rig, saying.alone);
    if (constraints) continue;
    const bool lacks = std::any_of(saying.names.begin(), saying.names.end(), [&](const std::string& name) {
      return says(name) && !names.find(name, "");
    });
    return Ineligible{constraints.error(), lacks};
  }
  return std::nullopt;
}

std::optional<Error> none_eligible(const Dataset& data, const RefineOptions& options, int cam,
                                   const std::vector<std::string>& lenses) {
  std::optional<Ineligible> last;
  for (const std::string& lens : lenses) {
    auto why = ineligible(data, options, cam, lens);
    if (!why) return std::nullopt;
    if (!last || !why->lacks_name) last = std::move(why);
  }
  if (!last) return std::nullopt;
  if (!last->lacks_name) return last->error;
  return Error{ErrorCode::kInvalidData,
               fmt::format("no lens that is tried for camera {} has a parameter of this name ({})",
                           data.cameras[cam].name, join(lenses, ", ")),
               last->error.where};
}

Status check_choice(const Dataset& data, const RefineOptions& options,
                    const std::vector<std::string>& chosen) {
  const auto rig = rig_of(data, options, chosen);
  if (!rig) return {};
  const auto constraints = constraints_of(*rig, options);
  if (constraints) return {};
  std::vector<std::string> each;
  for (std::size_t i = 0; i < chosen.size(); ++i) each.push_back(data.cameras[i].name + "=" + chosen[i]);
  Error error = constraints.error();
  error.message += "; the lenses chosen are " + join(each, ",") + ": name those that you want";
  return error;
}

}  // namespace plumbline::detail
