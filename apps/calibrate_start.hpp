// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "calibrate_inputs.hpp"
#include "plumbline/refine/refine.hpp"

namespace plumbline::apps {

/// Where the solve of `calibrate` starts: from corners alone, from camera files, or from an earlier
/// calibration, with more views or without.
struct CalibrateStart {
  std::string earlier;                ///< a calibration.yaml
  bool add = false, replace = false;  ///< the inputs' views are added to the earlier ones
  std::vector<std::string> start{};   ///< auto, zhang, dlt, or camera files
  std::vector<std::string> fixed, ties, priors, only;
};

void add_start_options(CLI::App& app, CalibrateStart& start);

/// Wrong usage of the options together, before any file is touched.
void check_usage(const CalibrateStart& start, const CalibrateInputs& inputs);

/// The corners to solve, and the start when there is one.
struct Problem {
  Dataset data;
  std::optional<Calibration> start;
  Observed observed{};
};
/// \param lens  --lens as the user wrote it; empty: opencv5, or the lenses of the start
Result<Problem> load_problem(const CalibrateStart& start, const CalibrateInputs& inputs,
                             const std::string& lens, const Common& common);

/// What the options say of the start and of single parameters; a malformed one is wrong usage.
void fill_options(const CalibrateStart& start, RefineOptions& options);

}  // namespace plumbline::apps
