// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "plumbline/assess/compare.hpp"
#include "plumbline/core/result.hpp"
#include "plumbline/rig/calibration.hpp"

namespace plumbline {

/// What the referee says of one camera. rms figures are per coordinate pair as rms_px everywhere.
struct CameraCrosscheck {
  std::string name, lens;
  std::string referee_lens;  ///< "LENSMODEL_OPENCV5"; for a lens that mrcal lacks, the one fitted to it
  double rms_px = 0, referee_rms_px = 0;  ///< this camera ALONE: ours and mrcal's optimum on the same corners
  DiffPx diff_px;                         ///< projection difference over the image of the two lone optima
  std::vector<double> parameters, referee_parameters;
};

struct Crosscheck {
  std::vector<CameraCrosscheck> cameras;
  double rms_px = 0, referee_rms_px = 0;  ///< the joint solve of all cameras
  double referee_rms_from_seed_px = 0;    ///< mrcal started from our seed instead of our optimum
  std::vector<std::string> notes;         ///< what could not be compared and why
};

/// mrcal 2.2 solves the same inlier corners with the same lens, from our seed and from our optimum, without
/// its regularisation, outlier rejection and board warp.
Result<Crosscheck> crosscheck_mrcal(const Calibration& calibration);

}  // namespace plumbline
