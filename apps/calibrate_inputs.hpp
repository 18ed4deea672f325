// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "args.hpp"

namespace plumbline::apps {

/// Where `calibrate` takes its corners from: images and a target, our corners.yaml, or mrcal's corners.vnl
/// and a target.
struct CalibrateInputs {
  std::string corners, image_size;
  std::string pair_by{};  ///< name or order; empty: by name
  std::vector<std::string> targets, cams;
  std::vector<Target> known_targets{};  ///< used where no --target is given
  std::string times{};                  ///< add_times()
  int every = 15;                       ///< of videos
  std::optional<double> thin_px{};      ///< thin_near_duplicates()
};

/// Wrong usage of the options together, before any file is touched.
void check_usage(const CalibrateInputs& inputs);
void add_input_options(CLI::App& app, CalibrateInputs& inputs);

/// The images that corners were found in; none with corners files.
struct Observed {
  std::vector<CameraImages> images;
  std::vector<std::string> notes;  ///< what is to be said of them
};
Result<Dataset> load_observations(const CalibrateInputs& inputs, const Common& common, Observed& observed);

/// --lens: "opencv5" or "left=opencv8,right=kb4", to one lens per camera. A camera that it does not name has
/// an empty one where there is a start, whose lens it keeps; otherwise that is wrong usage.
Result<std::vector<std::string>> parse_lenses(const std::string& argument,
                                              const std::vector<CameraInfo>& cameras, bool has_start);

}  // namespace plumbline::apps
