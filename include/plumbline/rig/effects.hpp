// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "plumbline/rig/calibration.hpp"

namespace plumbline {

/// A bow, line delay or time offset that is a parameter of a calibration.
struct EffectValue {
  std::string parameter;        ///< as shared_parameter_names() has it: "left line_delay"
  double value = 0;             ///< [m] or [s]
  std::optional<double> sigma;  ///< by the covariance, where there is one
  std::string unit;             ///< "m" or "s"
};

/// All of them, in the order of shared_parameter_names(); empty for a calibration without.
std::vector<EffectValue> effect_values(const Calibration& calibration);

}  // namespace plumbline
