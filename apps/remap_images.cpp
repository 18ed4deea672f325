// SPDX-License-Identifier: Apache-2.0
#include "remap_images.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <mutex>
#include <opencv2/imgproc.hpp>

#include "pictures.hpp"
#include "plumbline/core/parallel.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/image/image.hpp"

namespace plumbline::apps {
namespace fs = std::filesystem;

Result<int> find_camera(const Rig& rig, const std::string& name, const std::string& file) {
  if (const auto cam = rig.find(name)) return *cam;
  if (rig.cameras.size() == 1) return 0;
  std::vector<std::string> names;
  for (const Camera& camera : rig.cameras) names.push_back(camera.name);
  return Error{ErrorCode::kInvalidData,
               fmt::format("there is no camera '{}'; there are: {}", name, join(names, ", ")), file};
}

Status remap_images(const CameraImages& images, ImageSize size, const RemapMaps& maps, const fs::path& folder,
                    const Common& common, Progress& progress) {
  const std::vector<std::string> names = picture_names(images);
  std::error_code error;
  fs::create_directories(folder / images.camera, error);
  if (error) return Error{ErrorCode::kIo, error.message(), (folder / images.camera).string()};
  const int n = static_cast<int>(images.files.size());
  std::vector<Status> statuses(images.files.size());
  std::mutex lock;
  int n_done = 0;
  for_each_image(images.files, ReadAs::kStored, common.n_threads, [&](int i, const Result<Photograph>& read) {
    statuses[i] = [&]() -> Status {
      if (!read) return read.error();
      const cv::Mat& image = read->pixels;
      if (image.cols != size.width || image.rows != size.height) {
        return Error{ErrorCode::kInvalidData,
                     fmt::format("the image is {}x{}, camera {} was calibrated with {}x{}", image.cols,
                                 image.rows, images.camera, size.width, size.height),
                     images.names[i]};
      }
      return write_png(folder / images.camera / (names[i] + ".png"), remap_image(image, maps));
    }();
    const std::lock_guard guard(lock);
    progress(++n_done, n);
  });
  for (Status& status : statuses) {
    if (!status) return std::move(status);
  }
  return {};
}

namespace {
cv::Mat pair_with_lines(const cv::Mat& first, const cv::Mat& second, bool vertical) {
  cv::Mat pair;
  if (vertical)
    cv::vconcat(in_colour(first), in_colour(second), pair);
  else
    cv::hconcat(in_colour(first), in_colour(second), pair);
  const int across = vertical ? pair.cols : pair.rows, step = std::max(10, across / 16);
  for (int at = step / 2, i = 0; at < across; at += step, ++i) {
    const cv::Scalar colour = i % 2 ? cv::Scalar(80, 200, 80) : cv::Scalar(60, 120, 240);
    if (vertical)
      cv::line(pair, {at, 0}, {at, pair.rows - 1}, colour);
    else
      cv::line(pair, {0, at}, {pair.cols - 1, at}, colour);
  }
  return pair;
}
}  // namespace

Status write_pairs(const std::vector<CameraImages>& images, const fs::path& folder, bool vertical,
                   const Common& common) {
  std::error_code error;
  fs::create_directories(folder / "pairs", error);
  if (error) return Error{ErrorCode::kIo, error.message(), (folder / "pairs").string()};
  std::vector<Status> statuses(images[0].files.size());
  parallel_for(static_cast<int>(images[0].files.size()), common.n_threads, [&](int i) {
    const auto& frames = images[1].frames;
    const auto match = std::find(frames.begin(), frames.end(), images[0].frames[i]);
    if (match == frames.end()) return;
    const auto picture_of = [&](int camera, std::ptrdiff_t k) {
      return read_image(folder / images[camera].camera / (picture_names(images[camera])[k] + ".png"));
    };
    const auto first = picture_of(0, i), second = picture_of(1, match - frames.begin());
    if (!first || !second) {
      statuses[i] = first ? second.error() : first.error();
      return;
    }
    std::string name = images[0].frames[i];
    std::replace(name.begin(), name.end(), '/', '_');
    statuses[i] = write_png(folder / "pairs" / (name + ".png"), pair_with_lines(*first, *second, vertical));
  });
  for (Status& status : statuses) {
    if (!status) return std::move(status);
  }
  return {};
}

}  // namespace plumbline::apps
