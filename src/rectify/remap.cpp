// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rectify/remap.hpp"

#include <opencv2/imgproc.hpp>

#include "plumbline/core/parallel.hpp"

namespace plumbline {

RemapMaps remap_maps(const Camera& camera, const Mat3& R_new_cam, const Mat3& K_new, ImageSize new_size,
                     int n_threads) {
  PLUMBLINE_CHECK(new_size.width > 0 && new_size.height > 0, "the new image has a size");
  RemapMaps maps;
  maps.x.create(new_size.height, new_size.width, CV_32FC1);
  maps.y.create(new_size.height, new_size.width, CV_32FC1);
  const Mat3 ray_of_px = R_new_cam.transpose() * K_new.inverse();
  std::vector<int> valid(new_size.height, 0);
  parallel_for(new_size.height, n_threads, [&](int row) {
    float *x = maps.x.ptr<float>(row), *y = maps.y.ptr<float>(row);
    const double right = camera.size.width - 0.5, bottom = camera.size.height - 0.5;
    for (int col = 0; col < new_size.width; ++col) {
      const auto px = project(camera.lens, ray_of_px * Vec3(col, row, 1));
      x[col] = px ? static_cast<float>(px->x()) : -1.0F;
      y[col] = px ? static_cast<float>(px->y()) : -1.0F;
      valid[row] += px && px->x() >= -0.5 && px->y() >= -0.5 && px->x() <= right && px->y() <= bottom;
    }
  });
  double sum = 0;
  for (int n : valid) sum += n;
  maps.valid_fraction = sum / (static_cast<double>(new_size.width) * new_size.height);
  return maps;
}

RemapMaps rectification_maps(const StereoRectification& rectification, const Camera& camera, int which,
                             int n_threads) {
  PLUMBLINE_CHECK(which == 0 || which == 1, "a rectified pair has cameras 0 and 1");
  return remap_maps(camera, rectification.R_rect_cam[which], rectification.P[which].leftCols<3>(),
                    rectification.size, n_threads);
}

cv::Mat remap_image(const cv::Mat& image, const RemapMaps& maps) {
  PLUMBLINE_CHECK(!image.empty() && !maps.x.empty(), "an image and its maps");
  cv::Mat out;
  cv::remap(image, out, maps.x, maps.y, cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar::all(0));
  return out;
}

}  // namespace plumbline
