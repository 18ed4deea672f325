// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "plumbline/rig/calibration.hpp"

namespace plumbline::detail {

/// A start that knows only the corners and the names of the lenses: K of each camera by Zhang's method as if
/// its lens had no distortion, board poses and extrinsics from it, spread along shared frames. Where the
/// views do not give a K: the focal length alone; where that fails too, the optimum's focal length and 5 %,
/// which is said in `note`. Frames that the seed cannot reach keep no pose.
struct NaiveSeed {
  Calibration calibration;
  std::string note;
};
NaiveSeed naive_seed(const Calibration& optimum);

}  // namespace plumbline::detail
