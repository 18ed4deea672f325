// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <string_view>

#include "plumbline/core/result.hpp"
#include "plumbline/rig/calibration.hpp"

namespace plumbline {

/// calibration.yaml: everything a Calibration holds, every number with 17 digits, versioned. Reading gives
/// the same Calibration back. kParse names the field; kUnsupported for a newer version or an unknown lens.
std::string format_calibration(const Calibration& calibration);
Result<Calibration> parse_calibration(std::string_view yaml);

}  // namespace plumbline
