// SPDX-License-Identifier: Apache-2.0
#include "overlay.hpp"

#include <fmt/format.h>

#include <opencv2/imgproc.hpp>

#include "plumbline/core/parallel.hpp"
#include "plumbline/image/image.hpp"

namespace plumbline::apps {
namespace {

namespace fs = std::filesystem;

constexpr int kShift = 4;  // OpenCV draws at 1/16 px
cv::Point fixed_point(const Vec2& px) {
  return {static_cast<int>(std::lround(px.x() * (1 << kShift))),
          static_cast<int>(std::lround(px.y() * (1 << kShift)))};
}

cv::Scalar colour_of(double fraction) {
  cv::Mat hsv(1, 1, CV_8UC3, cv::Scalar(120 * fraction, 255, 255)), bgr;
  cv::cvtColor(hsv, bgr, cv::COLOR_HSV2BGR);
  const cv::Vec3b c = bgr.at<cv::Vec3b>(0, 0);
  return {double(c[0]), double(c[1]), double(c[2])};
}

cv::Mat drawn(const cv::Mat& image, const std::vector<Corner>& corners, std::size_t n_points) {
  cv::Mat picture;
  if (image.channels() == 1)
    cv::cvtColor(image, picture, cv::COLOR_GRAY2BGR);
  else
    picture = image.clone();
  const double arm_px = std::max(3.0, 0.006 * picture.cols);
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const cv::Scalar colour =
        colour_of(double(corners[i].point) / double(std::max<std::size_t>(n_points - 1, 1)));
    const Vec2& px = corners[i].px;
    if (i > 0)
      cv::line(picture, fixed_point(corners[i - 1].px), fixed_point(px), colour, 1, cv::LINE_AA, kShift);
    for (const Vec2& arm : {Vec2(arm_px, arm_px), Vec2(arm_px, -arm_px)}) {
      cv::line(picture, fixed_point(px - arm), fixed_point(px + arm), colour, 1, cv::LINE_AA, kShift);
    }
  }
  return picture;
}

}  // namespace

Status write_overlays(const std::vector<CameraImages>& images, const Dataset& data, const fs::path& folder,
                      const Common& common) {
  struct Job {
    fs::path file, picture;
    const View* view;
  };
  std::vector<Job> jobs;
  for (const CameraImages& of_camera : images) {
    std::error_code error;
    fs::create_directories(folder / of_camera.camera, error);
    if (error) return Error{ErrorCode::kIo, error.message(), (folder / of_camera.camera).string()};
    for (std::size_t i = 0; i < of_camera.files.size(); ++i) {
      for (const View& view : data.views) {
        if (data.cameras[view.cam].name != of_camera.camera || view.image != of_camera.names[i]) continue;
        jobs.push_back({of_camera.files[i],
                        folder / of_camera.camera / (of_camera.files[i].stem().string() + ".png"), &view});
      }
    }
  }
  std::vector<Status> statuses(jobs.size());
  parallel_for(static_cast<int>(jobs.size()), common.n_threads, [&](int i) {
    auto image = read_image(jobs[i].file);
    if (!image)
      statuses[i] = image.error();
    else
      statuses[i] = write_png(jobs[i].picture, drawn(*image, jobs[i].view->corners,
                                                     data.targets[jobs[i].view->target].points.size()));
  });
  for (Status& status : statuses) {
    if (!status) return std::move(status);
  }
  return {};
}

}  // namespace plumbline::apps
