// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <string_view>

#include "plumbline/core/result.hpp"
#include "plumbline/rig/calibration.hpp"

namespace plumbline {

/// calibration.yaml: everything a Calibration holds, every number with the digits that it takes, versioned.
/// Reading gives the same Calibration back, and writing that the same bytes. kParse names the field and its
/// line; kUnsupported for a newer version or an unknown lens. A file may stop after the rig (cameras,
/// T_cam_rig): the data are empty then, and so they are written when the target has no points. \pre cameras
/// and frames have distinct names, views and fits have their sizes, and all numbers are finite
std::string format_calibration(const Calibration& calibration);
Result<Calibration> parse_calibration(std::string_view yaml);

}  // namespace plumbline
