// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "plumbline/rig/calibration.hpp"

/// Simulated views with wrong corners, and what others make of them.
namespace plumbline::bench {

/// How corners go wrong.
enum class Fault {
  kNone,
  kUniform,  ///< 5 % of the corners anywhere in the image
  kNear,     ///< 5 % of the corners 5 to 20 px off
  kSwapped,  ///< 5 % of the corners changed places with a neighbour
  kShifted   ///< one view of twenty counts its rows from one too far, the last row for the first
};
const char* name_of(Fault fault);

struct Kind {
  std::string lens;
  double fov_deg = 60;
};

/// One camera of 1280 x 960 pixels, 20 views of 11 x 8 corners with 0.2 px of noise, and the truth.
Calibration make_truth(const Kind& kind, std::uint64_t seed);

/// The corners of `clean` with the fault. The others keep their noise.
Dataset with_fault(const Dataset& clean, Fault fault, std::uint64_t seed);

/// RMS distance [px] of the projections of two lenses over the true camera's image, after the rotation that
/// fits best: within 5 % of the image's diagonal of a corner of any view, and over the whole image, which
/// includes what no corner ever said anything of.
struct ErrorPx {
  double near = 0, whole = 0;
};
/// nullopt when they cannot be compared.
std::optional<ErrorPx> error_px(const Calibration& truth, const Camera& estimate);

/// cv::calibrateCamera or cv::fisheye::calibrate on these corners; nullopt when it throws or has no such
/// lens.
std::optional<Camera> by_opencv(const Dataset& data, const Kind& kind);

/// mrcal with its outlier rejection, started at the truth; nullopt when it fails or has no such lens.
std::optional<Camera> by_mrcal(const Calibration& truth, const Dataset& data);

}  // namespace plumbline::bench
