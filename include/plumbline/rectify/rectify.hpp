// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <optional>
#include <string>

#include "plumbline/core/result.hpp"
#include "plumbline/rig/calibration.hpp"

namespace plumbline {

/// No plane shows a half space: directions further than this from the rectified optical axis are left out,
/// whatever alpha asks for. A fisheye of 190 degrees rectified with alpha = 1 keeps the inner 160 degrees of
/// its view.
inline constexpr double kMaxHalfAngle_deg = 80.0;

/// A baseline nearer than this to an optical axis leaves that axis outside the rectified plane's view.
inline constexpr double kMinBaselineAngle_deg = 90.0 - kMaxHalfAngle_deg;

struct RectifyOptions {
  /// As OpenCV's: 0: only valid pixels, 1: every source pixel (as far as kMaxHalfAngle_deg); the focal length
  /// of a value in between is the mixture of the two. \pre in [0, 1]
  double alpha = 0.0;
  ImageSize size;  ///< of the rectified images; {0, 0}: as the first camera's
};

/// A rectified stereo pair, in OpenCV's convention: p_rect = R_rect_cam * p_cam;  w [px_rect; 1] = P
/// [p_rect1; 1] where p_rect1 is the point in the FIRST camera's rectified frame; [X Y Z W]' = Q [x y
/// disparity 1]'.
struct StereoRectification {
  std::array<std::string, 2> cameras;
  ImageSize size;                  ///< of both rectified images [px]
  std::array<Mat3, 2> R_rect_cam;  ///< R1, R2
  /// P1, P2: common focal length > 0 [px], the same principal point (disparity 0 at infinity). P2's fourth
  /// column is f * t along the axis of the baseline, t the first camera's centre seen from the second:
  /// -baseline when the second camera is to the right (or below), +baseline when it is to the left (or
  /// above); then disparities are negative.
  std::array<Mat34, 2> P;
  Mat4 Q = Mat4::Zero();
  bool vertical = false;  ///< cameras one above the other: disparity along y
  double baseline_m = 0;
};

/// Calibrated stereo rectification as Bouguet does it (and cv::stereoRectify): half of the relative rotation
/// to each camera, then the smallest rotation that lays the baseline along an image axis. Works for cameras
/// side by side and one above the other; the focal length is common and positive for any lens; the first
/// camera's up stays up: which image axis the baseline takes is decided in the first image, and a second
/// camera mounted a quarter or half turn about its axis is turned to match first. The cameras keep their
/// order. Failures: kUnsupported when the rig has not two cameras (or `first`, `second` do not exist);
/// kDegenerate when the baseline is zero, lies nearer than kMinBaselineAngle_deg to an optical axis (names
/// the angle), or the two cameras see no direction in common.
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

/// Undistortion of one camera: the pinhole camera of the same orientation that shows it. alpha as above; fx
/// and fy are apart, as in cv::getOptimalNewCameraMatrix: the largest rectangle of valid pixels (0) or the
/// smallest around all source pixels (1) fills the image. `size` {0, 0}: as the camera's. kDegenerate when
/// the lens sees nothing near its axis.
Result<Pinhole> undistorted_camera(const Camera& camera, double alpha, ImageSize size = {});

}  // namespace plumbline
