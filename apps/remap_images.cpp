// SPDX-License-Identifier: Apache-2.0
#include "remap_images.hpp"

#include <fmt/format.h>

#include <mutex>
#include <opencv2/imgproc.hpp>
#include <set>

#include "plumbline/core/parallel.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/image/image.hpp"

namespace plumbline::apps {
namespace fs = std::filesystem;

namespace {
void draw_lines(cv::Mat& image) {
  if (image.channels() == 1) cv::cvtColor(image, image, cv::COLOR_GRAY2BGR);
  for (int y = 20; y < image.rows; y += 40) {
    cv::line(image, {0, y}, {image.cols - 1, y},
             (y / 40) % 2 ? cv::Scalar(80, 200, 80) : cv::Scalar(60, 120, 240), 1);
  }
}

Status check_stems(const CameraImages& images) {
  std::set<std::string> stems;
  for (const fs::path& file : images.files) {
    if (!stems.insert(file.stem().string()).second) {
      return Error{ErrorCode::kInvalidData,
                   fmt::format("two images of camera {} are called '{}'; take them in two runs",
                               images.camera, file.stem().string()),
                   file.string()};
    }
  }
  return {};
}
}  // namespace

Result<int> find_camera(const Rig& rig, const std::string& name, const std::string& file) {
  if (const auto cam = rig.find(name)) return *cam;
  if (rig.cameras.size() == 1) return 0;
  std::vector<std::string> names;
  for (const Camera& camera : rig.cameras) names.push_back(camera.name);
  return Error{ErrorCode::kInvalidData,
               fmt::format("there is no camera '{}'; there are: {}", name, join(names, ", ")), file};
}

Status remap_images(const CameraImages& images, ImageSize size, const RemapMaps& maps, const fs::path& folder,
                    bool lines, const Common& common, Progress& progress) {
  if (Status s = check_stems(images); !s) return s;
  std::error_code error;
  fs::create_directories(folder / images.camera, error);
  if (error) return Error{ErrorCode::kIo, error.message(), (folder / images.camera).string()};
  const int n = static_cast<int>(images.files.size());
  std::vector<Status> statuses(images.files.size());
  std::mutex lock;
  int n_done = 0;
  parallel_for(n, common.n_threads, [&](int i) {
    statuses[i] = [&]() -> Status {
      auto image = read_image(images.files[i]);
      if (!image) return image.error();
      if (image->cols != size.width || image->rows != size.height) {
        return Error{ErrorCode::kInvalidData,
                     fmt::format("the image is {}x{}, camera {} was calibrated with {}x{}", image->cols,
                                 image->rows, images.camera, size.width, size.height),
                     images.names[i]};
      }
      cv::Mat result = remap_image(*image, maps);
      if (lines) draw_lines(result);
      return write_png(folder / images.camera / (images.files[i].stem().string() + ".png"), result);
    }();
    const std::lock_guard guard(lock);
    progress(++n_done, n);
  });
  for (Status& status : statuses) {
    if (!status) return std::move(status);
  }
  return {};
}

}  // namespace plumbline::apps
