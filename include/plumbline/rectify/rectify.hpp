// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "plumbline/core/result.hpp"
#include "plumbline/rig/calibration.hpp"

namespace plumbline {

struct RectifyOptions {
  double alpha =
      0.0;  ///< as OpenCV's: 0: only valid pixels, 1: every source pixel; in between: a mixture. In [0, 1]
  ImageSize size;  ///< of the rectified images; {0, 0}: as the first camera's
};

/// A rectified stereo pair, in OpenCV's convention: p_rect = R_rect_cam * p_cam;  w [px_rect; 1] = P
/// [p_rect1; 1] where p_rect1 is the point in the FIRST camera's rectified frame; [X Y Z W]' = Q [x y
/// disparity 1]'.
struct StereoRectification {
  std::array<std::string, 2> cameras;
  ImageSize size;                  ///< of both rectified images [px]
  std::array<Mat3, 2> R_rect_cam;  ///< R1, R2
  std::array<Mat34, 2> P;  ///< P1, P2: common focal length > 0 [px]; P2's fourth column is -f * baseline
                           ///< along the axis of the baseline
  Mat4 Q = Mat4::Zero();
  bool vertical = false;  ///< cameras one above the other: disparity along y
  double baseline_m = 0;
};

/// Calibrated stereo rectification. Works for cameras side by side and one above the other; the focal length
/// is common and positive; the first camera's up stays up, and the second image is turned to match. Needs no
/// OpenCV call: kUnsupported when the rig has not two cameras (or `first`, `second` do not exist);
/// kDegenerate when the baseline is zero, or lies so near to an optical axis that no common image plane sees
/// both (names the angle).
Result<StereoRectification> rectify_stereo(const Rig& rig, int first, int second,
                                           const RectifyOptions& options = {});

/// Where a pixel of the original image of camera `which` (0, 1) comes to lie in its rectified image; nullopt
/// outside the lens' domain or behind the rectified plane.
std::optional<Vec2> rectify_pixel(const StereoRectification& rectification, const Lens& lens, int which,
                                  const Vec2& px);

/// Root mean square over all board corners seen by both cameras of the difference across the epipolar lines
/// (y for side by side, x for vertical) after rectification [px]; nullopt when no corner is seen by both.
std::optional<double> vertical_rms_px(const StereoRectification& rectification,
                                      const Calibration& calibration);

/// Undistortion of one camera: the pinhole camera (same orientation) that shows it. alpha as above.
Result<Pinhole> undistorted_camera(const Camera& camera, double alpha, ImageSize size = {});

}  // namespace plumbline
