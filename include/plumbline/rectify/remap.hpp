// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core/mat.hpp>

#include "plumbline/rectify/rectify.hpp"

namespace plumbline {

/// For each pixel of the new image, where to look in the old one: two CV_32FC1 matrices of the new size; (-1,
/// -1) where the old lens sees nothing.
struct RemapMaps {
  cv::Mat x, y;
  double valid_fraction = 0;  ///< of the new pixels that look inside the old image
};

/// Maps from a virtual pinhole camera with rotation R_new_cam (p_new = R_new_cam * p_cam) and 3x3 matrix
/// K_new.
RemapMaps remap_maps(const Camera& camera, const Mat3& R_new_cam, const Mat3& K_new, ImageSize new_size,
                     int n_threads = 0);

/// Maps of camera `which` (0, 1) of a rectified pair.
RemapMaps rectification_maps(const StereoRectification& rectification, const Camera& camera, int which,
                             int n_threads = 0);

/// The remapped image, bilinear; black where the maps say nothing.
cv::Mat remap_image(const cv::Mat& image, const RemapMaps& maps);

}  // namespace plumbline
