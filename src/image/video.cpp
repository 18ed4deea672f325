// SPDX-License-Identifier: Apache-2.0
#include "plumbline/image/video.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <string>

#include "image/video_stream.hpp"
#include "plumbline/core/text.hpp"

namespace plumbline {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::string_view, 20> kExtensions{
    ".mp4", ".m4v",  ".mov", ".avi", ".mkv", ".webm", ".mpg",  ".mpeg",  ".m2v", ".ts",
    ".mts", ".m2ts", ".wmv", ".flv", ".3gp", ".ogv",  ".mjpg", ".mjpeg", ".y4m", ".vob"};

constexpr int kSharpnessWidth = 1000;  ///< [px]; wider frames are reduced by whole numbers to this or less

/// Means over cells of n x n pixels.
cv::Mat reduced(const cv::Mat& grey, int n) {
  cv::Mat cells(grey.rows / n, grey.cols / n, CV_32F);
  for (int r = 0; r < cells.rows; ++r) {
    auto* out = cells.ptr<float>(r);
    std::fill(out, out + cells.cols, 0.0F);
    for (int k = 0; k < n; ++k) {
      const auto* in = grey.ptr<unsigned char>(n * r + k);
      for (int c = 0; c < cells.cols * n; ++c) out[c / n] += in[c];
    }
    for (int c = 0; c < cells.cols; ++c) out[c] /= static_cast<float>(n * n);
  }
  return cells;
}

/// Mean of the squared central differences.
double sharpness_of(const cv::Mat& grey) {
  const cv::Mat cells = reduced(grey, (grey.cols + kSharpnessWidth - 1) / kSharpnessWidth);
  if (cells.rows < 3 || cells.cols < 3) return 0;
  double sum = 0;
  for (int r = 1; r + 1 < cells.rows; ++r) {
    const auto *above = cells.ptr<float>(r - 1), *row = cells.ptr<float>(r), *below = cells.ptr<float>(r + 1);
    double of_row = 0;
    for (int c = 1; c + 1 < cells.cols; ++c) {
      const float dx = row[c + 1] - row[c - 1], dy = below[c] - above[c];
      of_row += static_cast<double>(dx * dx + dy * dy);
    }
    sum += of_row;
  }
  return sum / 4 / static_cast<double>((cells.rows - 2) * (cells.cols - 2));
}

}  // namespace

bool is_video(const fs::path& file) {
  std::string extension = file.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return std::find(kExtensions.begin(), kExtensions.end(), extension) != kExtensions.end();
}

fs::path frame_path(const fs::path& video, int frame) {
  return video.string() + fmt::format("#{:06d}", frame);
}

std::optional<VideoFrame> parse_frame_path(std::string_view path) {
  const std::size_t mark = path.rfind('#');
  if (mark == std::string_view::npos || !is_video(path.substr(0, mark))) return std::nullopt;
  const auto frame = parse_int(path.substr(mark + 1));
  if (!frame || *frame < 0 || path[mark + 1] == '+') return std::nullopt;
  return VideoFrame{path.substr(0, mark), *frame};
}

Result<VideoScan> scan_video(const fs::path& file, const std::function<void(int, int)>& progress) {
  auto video = detail::VideoStream::open(file);
  if (!video) return video.error();
  VideoScan scan;
  scan.frames_promised = video->facts().n_frames;
  for (int frame = 0; video->go_to(frame); ++frame) {
    const auto grey = video->pixels(true);
    if (!grey) return grey.error();
    const ImageSize size{grey->cols, grey->rows};
    if (frame > 0 && size != scan.size) {
      return Error{ErrorCode::kInvalidData,
                   fmt::format("frame {} has {}x{} pixels and those before it {}x{}: cut the video there",
                               frame, size.width, size.height, scan.size.width, scan.size.height),
                   file.string()};
    }
    scan.size = size;
    scan.sharpness.push_back(sharpness_of(*grey));
    if (progress) progress(frame + 1, scan.frames_promised);
  }
  if (!scan.sharpness.empty()) return scan;
  return Error{ErrorCode::kParse, "no frame of the video can be decoded", file.string()};
}

std::vector<std::vector<int>> sharpest_frames(const std::vector<std::vector<double>>& sharpness, int every) {
  PLUMBLINE_CHECK(every > 0, "a window has a frame at least");
  std::vector<std::vector<int>> chosen(sharpness.size());
  std::size_t longest = 0;
  for (const auto& of_video : sharpness) longest = std::max(longest, of_video.size());
  for (std::size_t begin = 0; begin < longest; begin += static_cast<std::size_t>(every)) {
    std::size_t end = begin + static_cast<std::size_t>(every);
    std::vector<std::size_t> videos;
    for (std::size_t v = 0; v < sharpness.size(); ++v) {
      if (sharpness[v].size() <= begin) continue;
      videos.push_back(v);
      end = std::min(end, sharpness[v].size());
    }
    std::vector<double> worst(end - begin, 1.0);
    for (const std::size_t v : videos) {
      const auto window = std::span(sharpness[v]).subspan(begin, end - begin);
      const double best = *std::max_element(window.begin(), window.end());
      for (std::size_t i = 0; i < window.size(); ++i)
        worst[i] = std::min(worst[i], best > 0 ? window[i] / best : 1.0);
    }
    const auto at = std::max_element(worst.begin(), worst.end()) - worst.begin();
    for (const std::size_t v : videos) chosen[v].push_back(static_cast<int>(begin) + static_cast<int>(at));
  }
  return chosen;
}

}  // namespace plumbline
