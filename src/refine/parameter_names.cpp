// SPDX-License-Identifier: Apache-2.0
#include "refine/parameter_names.hpp"

#include <algorithm>

#include "plumbline/core/text.hpp"

namespace plumbline::detail {
namespace {

bool names_step(const std::string& parameter) { return parameter.size() == 3 && parameter[1] == '_'; }
bool names_focal(const std::string& parameter) { return parameter == "fx" || parameter == "fy"; }
bool names_matrix(const std::string& parameter) {
  return names_focal(parameter) || parameter == "cx" || parameter == "cy";
}

}  // namespace

ParameterNames::ParameterNames(const Calibration& cal) : all_(shared_parameter_names(cal)) {
  for (const std::string& name : all_) {  // owners' names may hold spaces, parameters' do not
    const std::size_t at = name.rfind(' ');
    halves_.push_back({name.substr(0, at), name.substr(at + 1)});
  }
  for (const Camera& camera : cal.rig.cameras) cameras_.push_back(camera.name);
}

bool ParameterNames::is_focal(int i) const { return names_focal(parameter(i)); }
bool ParameterNames::is_step(int i) const { return names_step(parameter(i)); }
bool ParameterNames::is_turn(int i) const { return is_step(i) && parameter(i)[0] == 'r'; }

template <class Wanted>
std::vector<int> ParameterNames::where_is(Wanted&& wanted) const {
  std::vector<int> list;
  for (int i = 0; i < size(); ++i) {
    if (wanted(halves_[static_cast<std::size_t>(i)], (*this)[i])) list.push_back(i);
  }
  return list;
}

bool ParameterNames::in_group(const Name& name, const std::string& group) const {
  const bool step = names_step(name.parameter);
  if (group == "lens") return !step;
  if (group == "K") return names_matrix(name.parameter);
  if (group == "pose") return step;
  return group == "rig" && step && std::find(cameras_.begin(), cameras_.end(), name.owner) != cameras_.end();
}

Result<ParameterNames::Found> ParameterNames::find(const std::string& wanted,
                                                   const std::string& where) const {
  // The full name, a parameter of all cameras, a group of all, a camera's lens, a group of one camera.
  Found found{where_is([&](const Name& name, const std::string& all) {
    return all == wanted || name.owner + "." + name.parameter == wanted;
  })};
  if (found.at.empty())
    found.at = where_is([&](const Name& name, const auto&) { return name.parameter == wanted; });
  if (!found.at.empty()) return found;
  found.is_group = true;
  found.at = where_is([&](const Name& name, const auto&) { return in_group(name, wanted); });
  if (found.at.empty())
    found.at = where_is(
        [&](const Name& name, const auto&) { return name.owner == wanted && !names_step(name.parameter); });
  const std::size_t cut = wanted.find_last_of(". ");
  if (found.at.empty() && cut != std::string::npos) {
    const std::string owner = wanted.substr(0, cut), group = wanted.substr(cut + 1);
    found.at = where_is([&](const Name& name, const auto&) {
      return name.owner == owner && group != "rig" && in_group(name, group);
    });
  }
  if (found.at.empty()) return unknown(wanted, where);
  return found;
}

std::string ParameterNames::list(const std::vector<int>& at, const std::string& value) const {
  constexpr std::size_t kMost = 4;
  std::vector<std::string> some;
  for (std::size_t i = 0; i < std::min(kMost, at.size()); ++i) some.push_back((*this)[at[i]] + value);
  if (at.size() > kMost) some.emplace_back("...");
  return join(some, ", ");
}

bool ParameterNames::is_owner(const std::string& name) const {
  return std::find(cameras_.begin(), cameras_.end(), name) != cameras_.end() ||
         std::any_of(halves_.begin(), halves_.end(), [&](const Name& n) { return n.owner == name; });
}

Error ParameterNames::unknown(const std::string& wanted, const std::string& where) const {
  constexpr std::size_t kMost = 200;  // a spline's parameters are too many for a message
  const std::vector<std::string> some(
      all_.begin(), all_.begin() + static_cast<std::ptrdiff_t>(std::min(all_.size(), kMost)));
  const std::size_t cut = wanted.find_last_of(". ");
  const std::string owner = cut == std::string::npos ? "" : wanted.substr(0, cut);
  const std::string fault = owner.empty() || is_owner(owner) ? "no shared parameter has this name"
                                                             : "no camera or board is called '" + owner + "'";
  return {ErrorCode::kInvalidData,
          fault + "; there are: " + join(some, ", ") + (all_.size() > kMost ? ", ..." : "") +
              "; without the camera a name means all cameras; groups: lens, K, pose, rig, CAMERA, CAMERA.K, "
              "CAMERA.pose",
          where};
}

}  // namespace plumbline::detail
