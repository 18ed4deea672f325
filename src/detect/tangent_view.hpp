// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "plumbline/rig/rig.hpp"

/// Parts of a camera's image as pinhole cameras at the same place would see them: there straight lines are
/// straight, also where a wide lens bends them too much for a search in the image itself.
namespace plumbline::detail {

struct TangentView {
  Mat3 R_view_cam = Mat3::Identity();
  double focal_px = 1;
  ImageSize size;
  cv::Mat map;  ///< CV_32FC2: the pixel of the camera for each pixel of the view; far outside where none is
};

/// Views that together show what the camera sees up to 115 degrees from its axis, as sharp as its image is
/// in the middle of each: one for a camera that sees less than 55 degrees from its axis.
std::vector<TangentView> tangent_views(const Camera& camera);

cv::Mat warp(const cv::Mat& grey, const TangentView& view);

/// The camera's pixel of a pixel of the view.
std::optional<Vec2> camera_px(const Camera& camera, const TangentView& view, const Vec2& view_px);

}  // namespace plumbline::detail
