// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "io/yaml.hpp"
#include "plumbline/rig/calibration.hpp"

/// The parts of calibration.yaml that are there only when bows or clocks are: the keys `board_bow` and
/// `clocks`, and `effects` of the summary.
namespace plumbline::io {

void write_effect_values(std::string& out, const Calibration& calibration);
/// \pre rig and targets are read
void read_effect_values(const Field& root, Calibration& calibration);

void write_effect_tries(std::string& out, const std::vector<EffectTry>& effects);
std::vector<EffectTry> read_effect_tries(const Field& summary);

}  // namespace plumbline::io
