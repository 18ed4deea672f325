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
  std::string
      referee_lens;  ///< "LENSMODEL_OPENCV5"; for a lens that mrcal lacks, the one fitted to it; may be empty
  double rms_px = 0, referee_rms_px = 0;  ///< this camera ALONE: ours and mrcal's optimum on the same corners
  DiffPx diff_px;  ///< projection difference of the two lone optima over the image; for a fitted lens over
                   ///< the part of the image within 3 % of its diagonal of a corner, after the motion
                   ///< of the camera that fits best at the corners' median distance
  std::vector<double> parameters, referee_parameters;  ///< of the two lone optima
  DiffPx joint_diff_px;  ///< of the two joint optima, likewise; all 0 when there is no joint solve to compare
};

struct Crosscheck {
  std::vector<CameraCrosscheck> cameras;
  double rms_px = 0, referee_rms_px = 0;  ///< the joint solve of all cameras
  double referee_rms_from_seed_px = 0;    ///< mrcal started from our seed instead of our optimum
  std::optional<Vec2> bow_m,
      referee_bow_m;               ///< of the board where it is a parameter: ours, mrcal's calobject_warp
  std::vector<std::string> notes;  ///< what could not be compared and why
};

/// mrcal 2.2 solves the same inlier corners with the same lens, from a seed and from our optimum, without its
/// regularisation and outlier rejection, with its board warp where the calibration has a bow. The seed knows
/// nothing of the optimum: K by Zhang's method without distortion, board poses from it. A rig's cameras are
/// also solved alone, by refine() and by mrcal.
///
/// What mrcal cannot do is said in `notes`, and the figures then mean less: a target without a uniform grid,
/// or lenses of several kinds in one rig, are not solved but projected by mrcal at our optimum; a lens that
/// mrcal lacks (kb4) is compared with mrcal's splined stereographic lens, fitted to ours and then solved on
/// the same corners. kNotConverged when mrcal refuses a problem; kDegenerate when no view takes part.
Result<Crosscheck> crosscheck_mrcal(const Calibration& calibration);

}  // namespace plumbline
