// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "plumbline/rig/dataset.hpp"
#include "plumbline/rig/rig.hpp"

namespace plumbline {

/// What the solver made of one corner: residual = projection - measured [px].
struct CornerFit {
  Vec2 residual_px = Vec2::Zero();
  bool outlier = false;  ///< not used in the last solve
};

/// A direction of the shared parameters that the data hardly constrain.
struct WeakDirection {
  std::string parameters;   ///< "left fx (+0.71), left fy (+0.70)": what moves along it, largest share first
  double sigma = 0;         ///< standard deviation along it, in the unit of `parameters`' first entry
  std::string consequence;  ///< one sentence for the user with the number and what to do next
};

/// An effect that was tried because the caller left it to the data (Estimate::kAuto of refine/refine.hpp).
struct EffectTry {
  std::string effect;       ///< "board bow"
  int n_parameters = 0;     ///< 2 of a bow
  double f = 0;             ///< F statistic of the rise in cost without it
  double p_value = 0;       ///< the probability of so large an F by chance
  double bound = 0;         ///< under which it is kept
  bool kept = false;        ///< as parameters of the result
  std::string reason = {};  ///< why it could not be tried; empty where it was
};

/// A prior and what the corners made of it.
struct PriorPull {
  std::string parameter;  ///< of shared_parameter_names()
  double value = 0, sigma = 0;
  double pull_sigmas = 0;  ///< (estimate - value) / sigma: far from 0 the corners contradict it
};

struct SolveStats {
  double rms_px = 0;     ///< root of the mean over inlier corners of dx^2 + dy^2 (as OpenCV reports it)
  double rms_xy_px = 0;  ///< rms_px / sqrt(2) (as mrcal reports it)
  int n_corners = 0;     ///< inlier corners
  int n_outliers = 0;
  int iterations = 0;
  bool converged = false;
  std::string termination;  ///< why the solver stopped, one line
  std::vector<WeakDirection> weak;
  std::vector<PriorPull> priors;
  std::vector<EffectTry> effects = {};
};

/// One lens that was tried for one camera (refine/choose_lens.hpp).
struct LensTry {
  std::string camera, lens;
  int n_params = 0;
  double rms_px = 0;  ///< of the fit to all views, the camera alone
  double held_out_px =
      0;  ///< root mean square of what was left out and predicted, as rms_px; 0: not measured
  /// Mean squared held-out error less that of the lens with the least, as a fraction of the latter, and the
  /// standard error of that difference.
  double excess = 0, excess_sigma = 0;
  bool chosen = false;
  std::string reason;  ///< why it was not compared; empty where it was
};

/// How the calibration came to be: enough to run it again. No dates, no absolute paths.
struct Provenance {
  std::string version;                         ///< of Plumbline
  std::map<std::string, std::string> options;  ///< "lens", "loss", "start", "seed", "outliers", ...
  std::string corners_hash;                    ///< 64-bit FNV-1a of the corners, hexadecimal
  std::vector<LensTry> lens_tries = {};        ///< with --lens auto: all lenses tried, camera by camera
};

/// When the rows of a camera were exposed, beside what its timestamps say: row v of a view at
/// time_s + time_offset_s + line_delay_s (v - (height - 1) / 2) on the clock of camera 0.
struct CameraClock {
  std::optional<double> line_delay_s;   ///< from one row to the next [s]; nullopt: all rows at once
  std::optional<double> time_offset_s;  ///< nullopt: its clock is camera 0's
};

/// What the solver knows. `fits` runs parallel to `data.views` and their corners.
struct Calibration {
  Rig rig;
  Dataset data;
  std::vector<std::optional<SE3>>
      T_rig_board;  ///< pose of the first board, one per frame; nullopt: the frame was not used
  std::vector<SE3> T_board0_board{SE3()};    ///< one per target: p_board0 = T_board0_board[i] * p_board; the
                                             ///< same in all frames; [0] is the identity
  std::vector<std::vector<CornerFit>> fits;  ///< per view, per corner; empty for a view that was not used
  std::vector<std::string> view_reason;      ///< per view: why it was not used; empty when it was
  SolveStats stats;
  std::optional<MatX> covariance;  ///< of the shared parameters in the order of shared_parameter_names(),
                                   ///< unit noise scaled by the residuals
  Provenance provenance;
  /// How far each target is bowed, as (b_x, b_y) [m] of bow_shape() (target/bow.hpp); nullopt, or no entry:
  /// it is taken as flat, and its bow is no parameter.
  std::vector<std::optional<Vec2>> bow_m;
  /// Per camera; empty: nothing is known. With any line delay or offset, T_rig_board is a pose at the frame's
  /// time (rig/motion.hpp), and where the boards were when a row was exposed follows from the frames around
  /// it.
  std::vector<CameraClock> clocks;
};

/// Where a point of a target is in the target's own frame [m]: as printed, and bowed where a bow is known.
Vec3 board_point(const Calibration& calibration, int target, int point);

/// The bow of a target, where it is a parameter.
std::optional<Vec2> bow_of(const Calibration& calibration, int target);

/// The whole measurement model:  px = lens(T_cam_rig * T_rig_board * T_board0_board * p_board), with p_board
/// of board_point(), and T_rig_board at the time of the row where the point appears when the calibration has
/// clocks. nullopt outside the lens' domain or when the view's frame has no pose (with clocks: no motion).
std::optional<Vec2> predict(const Calibration& calibration, const View& view, int point);

/// T_rig_board * T_board0_board of a view: where its board stood in its frame. nullopt when the frame has no
/// pose.
std::optional<SE3> board_pose(const Calibration& calibration, const View& view);

/// "left fx", ..., "right r_x", "right t_x", ..., "board2 r_x", ...: lens parameters of each camera, then the
/// six numbers [rotation rad | translation m] of each T_cam_rig but the first, then those of each
/// T_board0_board but the first, then "board bow_x", "board bow_y" [m] of each target that has a bow, then
/// "left line_delay" [s], "right time_offset" [s] of each camera that has them; the order of every vector
/// over the shared parameters.
std::vector<std::string> shared_parameter_names(const Calibration& calibration);
/// The same for a calibration of one flat board.
std::vector<std::string> shared_parameter_names(const Rig& rig);

/// rms_px over the inlier corners of one camera, or of one view; 0 when there are none.
double camera_rms_px(const Calibration& calibration, int cam);
double view_rms_px(const Calibration& calibration, int view);

/// 64-bit FNV-1a over cameras, frames and corners, as 16 hexadecimal digits.
std::string corners_hash(const Dataset& data);

}  // namespace plumbline
