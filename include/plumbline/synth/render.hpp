// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"
#include "plumbline/synth/board.hpp"

namespace plumbline {

/// How a rendered image looks. Grey levels are 0..255.
struct RenderOptions {
  double white_grey = 225, black_grey = 25;  ///< of the printed sheet
  double background_grey = 120;              ///< what is behind the boards, and outside the lens' domain
  double texture_grey = 0;                   ///< amplitude of smooth random blotches in the background
  double back_grey = 90;                     ///< back sides of boards: opaque and plain
  double blur_sigma_px = 0;                  ///< Gaussian point spread
  double vignetting = 0;   ///< share of light lost in the image's corners, growing with radius^2
  double noise_grey = 0;   ///< standard deviation of normal noise
  std::uint64_t seed = 0;  ///< of noise and texture
  int n_threads = 0;       ///< <= 0: all cores; the image does not depend on it
};

/// The rays of all pixel corners of a camera: computed once, used for each of its images.
struct CameraRays {
  ImageSize size;
  std::vector<Vec3>
      rays;  ///< unit; corner (c, r) of (width + 1) x (height + 1) is at pixel (c - 0.5, r - 0.5); zero: none
};
CameraRays camera_rays(const Lens& lens, ImageSize size, int n_threads = 0);

/// The boards as the camera sees them, CV_8UC1. A pixel is the mean of the light on its unit square around
/// its centre: where one sheet fills it, the area of the black shapes in it is exact for straight edges (the
/// pixel's corners are traced through the lens and joined by a homography, so that only the lens' curvature
/// WITHIN a pixel is left out) and good to 1e-3 for circles; where sheets overlap or pass behind the camera,
/// the mean of 16 x 16 rays. The nearest sheet along each ray is seen; a sheet seen from behind is plain.
/// Rays may point backwards, so fisheye lenses beyond 180 degrees work. Printed ruler and text are not
/// rendered. \pre rays has the size that it says
cv::Mat render(const std::vector<BoardDrawing>& drawings, const CameraRays& rays, const SE3& T_cam_target,
               const RenderOptions& options = {});

/// The same as CV_32FC1 grey levels, before noise and rounding.
cv::Mat render_grey_levels(const std::vector<BoardDrawing>& drawings, const CameraRays& rays,
                           const SE3& T_cam_target, const RenderOptions& options = {});

}  // namespace plumbline
