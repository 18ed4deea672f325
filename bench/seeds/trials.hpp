// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <string>

#include "plumbline/rig/calibration.hpp"

namespace bench {

/// One kind of trial of the start without a focal length.
struct TrialKind {
  double fov_deg = 60;  ///< across the longer side of the image
  double noise_px = 0.1;
  int n_views = 20;
  std::string lens = "opencv5";  ///< or kb4
};

/// A camera of 1280 x 960 pixels, its centre off by up to 15 % of each side, with random distortion that does
/// not fold inside the image; boards of 9 x 6 corners at random, tilted by up to 45 degrees, at least three
/// of them by 15 or more. Corners that fall outside the image are not seen; views keep 12 or more. The
/// calibration is the truth, its corners with noise.
plumbline::Calibration make_trial(const TrialKind& kind, std::uint64_t seed);

}  // namespace bench
