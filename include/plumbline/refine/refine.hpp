// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/rig/calibration.hpp"

namespace plumbline {

enum class Loss { kSquared, kHuber, kCauchy };
enum class Start { kAuto, kZhang, kDlt };
enum class Solver {
  kBlocks,  ///< written for this problem's shape; Ceres where it does not apply
  kCeres    ///< the reference: same optimum, slower
};

/// Whether something beyond lenses and poses is estimated.
enum class Estimate {
  kNo,
  kYes,
  kAuto  ///< when it lowers the cost by more than chance would: an F-test with a false-alarm rate of 1 % over
         ///< all that are tried; stats.effects tells of each
};

/// What is known of a parameter from elsewhere: ((parameter - value) / sigma)^2 is added to the cost, in
/// which the corners weigh by their own scatter.
struct Prior {
  std::string parameter;
  double value = 0, sigma = 0;  ///< in the parameter's unit: pixels, none, radians or metres
};

struct RefineOptions {
  /// One for all cameras, or one per camera in order; "auto": calibrate() chooses by choose_lenses().
  std::vector<std::string> lenses{"opencv5"};
  Start start = Start::kAuto;  ///< kAuto: DLT where a camera has a view with enough non-coplanar points,
                               ///< Zhang otherwise
  Loss loss = Loss::kSquared;
  double loss_scale_px = 1.0;  ///< where Huber and Cauchy bend [px]; in sigmas with use_sigma
  bool mark_outliers = true;   ///< corners beyond outlier_sigma robust standard deviations are left out
  double outlier_sigma = 5.0;
  /// Shared parameters that do not move: "left fx" stays at its start value, "left fx=532.8" at that one. A
  /// name is one of shared_parameter_names() ("left.fx" is the same as "left fx"), or such a name without the
  /// camera, which means every camera ("k3"), or a group: "lens", "K" (fx fy cx cy), "pose", "rig" (where the
  /// cameras stand), "left" (its lens), "left.K", "left.pose".
  std::vector<std::string> fixed;
  /// Parameters that share one value: "fx=fy" in each camera, "left fx=right fx", "left=right" (all of the
  /// two lenses). Rotations cannot be tied.
  std::vector<std::string> ties;
  std::vector<Prior> priors;
  /// Cameras to solve for: the lenses and poses of all others are held. Empty: all. Board poses always move.
  std::vector<std::string> only;
  bool use_sigma = false;  ///< weight each corner by 1 / sigma_px
  int max_iterations = 200;
  Solver solver = Solver::kBlocks;
  int n_threads = 0;             ///< <= 0: all cores; results do not depend on it
  Estimate bow = Estimate::kNo;  ///< of each flat board (Calibration::bow_m)
  /// Of each camera, and of each but the first (Calibration::clocks). Both need times of all views, and
  /// frames that follow one another as a smooth motion does: kDegenerate says what is missing. kAuto without
  /// times: no.
  Estimate line_delay = Estimate::kNo, time_offset = Estimate::kNo;
};

/// Calibrates from corners alone: seed (no focal length needed), joint refinement of all lenses, extrinsics
/// and board poses, outlier marking, covariance. Cameras are joined by frames in which they see the same
/// board, by any chain of cameras and boards, or where there is none by their common motion before boards of
/// their own (docs/refine.md). Failures: kDegenerate when there are too few views, or views that do not
/// constrain a lens (all fronto-parallel), or cameras that nothing connects (names the groups, the frames
/// that nearly do, and what to photograph); kInvalidData for a bad data set; kNotConverged when no start
/// leads to a finite optimum.
Result<Calibration> calibrate(const Dataset& data, const RefineOptions& options);

/// Refines from a given start (rig and board poses already set; frames without a pose are not used). Marks of
/// the start are forgotten. kNotConverged names the view when a corner lies outside its lens' domain at the
/// start and outliers are not marked; the other failures are those of calibrate(). PLUMBLINE_CHECK: cameras,
/// poses and frames belong together. In both, a corner that its lens does not project has a zero residual in
/// `fits` and is marked as an outlier.
Result<Calibration> refine(const Calibration& start, const RefineOptions& options);

}  // namespace plumbline
