// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>

#include "args.hpp"
#include "calibrate_inputs.hpp"
#include "plumbline/detect/second_look.hpp"
#include "plumbline/refine/refine.hpp"

/// `calibrate` from images: detect, calibrate, look again, calibrate again.
namespace plumbline::apps {

/// What the second look did.
struct LookReport {
  SecondLook look;
  Dataset first;          ///< what the first look saw
  int circle_rounds = 0;  ///< solves until the centres of circles stood; 0: no circles
  double largest_bias_px = 0;
  double seconds = 0;  ///< of reading and looking, without the solves
  std::string note;    ///< why its corners were not used; empty when they were, or when there are none
};

/// Whether there are images for a second look: not with corners files, nor on top of an earlier calibration.
bool can_look_again(const CalibrateInputs& inputs, bool has_earlier);

/// Looks again and solves again where that gave something; `calibration` becomes the result.
/// \param from_start  whether the first solve was refine() with a given start, which the next ones then are
Result<LookReport> look_and_solve(const std::vector<CameraImages>& images, const RefineOptions& options,
                                  bool from_start, const Common& common, Calibration& calibration);

/// `detect --calibration`: the images once more by cameras that are known, in any readable camera files; only
/// where the boards stood is solved for. `data` gets the corners that are added.
Result<LookReport> look_with(const std::string& calibration_file, const std::vector<CameraImages>& images,
                             const Common& common, Dataset& data);
void add_look(const LookReport& report, const Dataset& data, Json& json);
std::string text_of_look(const LookReport& report, const Dataset& data);

void add_look(const LookReport& report, const Calibration& calibration, Json& json);
std::string text_of_look(const LookReport& report, const Calibration& calibration);

}  // namespace plumbline::apps
