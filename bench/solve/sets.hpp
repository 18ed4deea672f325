// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "plumbline/rig/calibration.hpp"

namespace bench {

/// A simulated calibration: what was seen, where every solver starts, and what is true.
struct SolveSet {
  plumbline::Calibration start;  ///< with the corners; poses off by 1.7 degrees and 3 %, focal lengths by 5
                                 ///< %, centres in the middle, no distortion
  plumbline::Rig truth;
};

/// A board of 10 x 14 corners, 30 mm apart, tilted up to 45 degrees, seen whole in 1920 x 1200 pixels by
/// every camera of a frame, with 0.3 px of noise. `lens`: opencv5, opencv8 or kb4 (130 degrees across), or
/// a splined lens by its spec, whose pictures an opencv5 lens made.
/// Cameras stand side by side, 60 mm apart (two) or 30 mm.
SolveSet make_set(const std::string& lens, int n_views, int n_cams);

/// Root mean square distance over the image of camera 0 between two lenses, ray by ray [px].
double lens_error_px(const plumbline::Rig& rig, const plumbline::Rig& truth);

}  // namespace bench
