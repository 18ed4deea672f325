// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rig/effects.hpp"

#include <cmath>

namespace plumbline {

std::vector<EffectValue> effect_values(const Calibration& calibration) {
  std::vector<EffectValue> list;
  for (int i = 0; i < static_cast<int>(calibration.data.targets.size()); ++i) {
    const auto bow = bow_of(calibration, i);
    if (!bow) continue;
    list.push_back({"", bow->x(), std::nullopt, "m"});
    list.push_back({"", bow->y(), std::nullopt, "m"});
  }
  for (const CameraClock& clock : calibration.clocks) {
    if (clock.line_delay_s) list.push_back({"", *clock.line_delay_s, std::nullopt, "s"});
    if (clock.time_offset_s) list.push_back({"", *clock.time_offset_s, std::nullopt, "s"});
  }
  // They are the last of the shared parameters.
  const std::vector<std::string> names = shared_parameter_names(calibration);
  const std::size_t first = names.size() - list.size();
  for (std::size_t i = 0; i < list.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(first + i);
    list[i].parameter = names[first + i];
    if (calibration.covariance && at < calibration.covariance->rows())
      list[i].sigma = std::sqrt(std::max(0.0, (*calibration.covariance)(at, at)));
  }
  return list;
}

}  // namespace plumbline
