// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "args.hpp"
#include "plumbline/refine/refine.hpp"

/// `calibrate --refine` and `--times`: bows of boards, line delays, time offsets.
namespace plumbline::apps {

struct EffectArgs {
  std::vector<std::string> refine;  ///< bow, line-delay, time-offset, auto
};
void add_effect_options(CLI::App& app, EffectArgs& args);
void set_effects(const EffectArgs& args, RefineOptions& options);

/// Gives the views their times: from a CSV file of image,time_s (images by their names as in the data set, or
/// without folders where that is unique), or from file names that are a whole number of nanoseconds. Seconds
/// since the first image's whole second, so that a double holds them to far below a nanosecond.
Status add_times(const std::string& times, Dataset& data);

void add_effects(const Calibration& calibration, Json& json);
std::string text_of_effects(const Calibration& calibration);

}  // namespace plumbline::apps
