// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "args.hpp"

namespace plumbline::apps {
/// What `calibrate --json` prints, but for `seconds`.
Json json_of_calibration(const Calibration& calibration);
/// What `calibrate` prints for people.
std::string text_of_calibration(const Calibration& calibration);
}  // namespace plumbline::apps
