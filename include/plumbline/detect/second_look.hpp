// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/detect/detect.hpp"
#include "plumbline/rig/calibration.hpp"

/// The images once more, now that a first calibration knows the lenses and where the boards stood: corners
/// that the search missed, boards that it did not find, and centres of circles without their bias.
/// detect_dataset() -> calibrate() -> look_again() -> calibrate() again with look.start.data; where there are
/// circles, settle_circles() with refine() before that.
namespace plumbline {

struct SecondLookOptions {
  int n_threads = 0;  ///< <= 0: all cores; results do not depend on it
  /// Called after each image that is looked at, as DetectOptions::progress.
  std::function<void(int, int)> progress = {};
};

/// What was added in the images of one camera.
struct LookCount {
  int corners = 0;  ///< in all
  int views = 0;    ///< that had no corners before
};

/// The discs of one view as they were measured, in the order of the view's corners.
struct CircleCentroids {
  int view = 0;
  std::vector<Vec2> px;
};

struct SecondLook {
  /// The calibration looked with, and all corners: views added to, views that have corners now, and poses of
  /// frames that had none. `fits`, statistics and covariance are empty. What refine() goes on from.
  Calibration start;
  std::vector<LookCount> by_camera;
  std::vector<CircleCentroids> circles;
  /// Of each target's discs as the images show them (ink spreads, and who printed may not have said) [m]; 0:
  /// no circle grid.
  std::vector<double> diameter_m;
  int n_images = 0;  ///< that were read
};

/// Looks again into every image where something is missing; images that show their board whole are not read,
/// but for circle grids, which are all measured anew.
///
/// A view whose frame has a pose (its own corners, or another camera's or board's through T_cam_rig and
/// T_board0_board) is searched where predict() puts its corners. An image that gave nothing in a frame
/// without a pose is cut into tangent views, in which the lens' own bend is taken out; the detector searches
/// those, and what it finds is only where to look: corners are always fitted in the image itself, along edges
/// bent as the lens bends them. What does not look like the board's other corners, lies off where its
/// neighbours foretell it, or contradicts the pose through all is left.
/// \param cameras  those of the data set, by their names; images go by their names
/// \pre the calibration has a view_reason and fits per view, as calibrate() leaves it
/// Failures: an image that cannot be read any more; kInvalidData: a camera or an image of the data set that
/// is not among `cameras`.
Result<SecondLook> look_again(const std::vector<CameraImages>& cameras, const Calibration& calibration,
                              const SecondLookOptions& options = {});

/// Puts the corners of circle grids where the circles' centres are: the measured centroid less
/// disc_image().bias_px() by the lenses and poses of `calibration`, whose data are those of look.start (its
/// corners may have been moved). Views without a pose stay.
struct CircleCorrection {
  double largest_px = 0;  ///< bias taken out of a corner
  double moved_px = 0;    ///< largest move of a corner against what it was: small when the centres stand
};
CircleCorrection correct_circles(const SecondLook& look, Calibration& calibration);

/// Centres make a calibration and that makes better centres: solve and correct_circles() in turn until no
/// corner moves by a thousandth of a pixel, three times at most.
struct SettledCircles {
  Calibration calibration;  ///< the last one solved, with the centres that it gave: what to solve finally
  int rounds = 0;           ///< solves
  CircleCorrection last;
};
/// \param solve  refine() with the caller's options. Its failure is this function's
/// Moves that do not halve from round to round are not taken: there a lens with many parameters bends to
/// single circles and they to it.
Result<SettledCircles> settle_circles(const SecondLook& look,
                                      const std::function<Result<Calibration>(const Calibration&)>& solve);

}  // namespace plumbline
