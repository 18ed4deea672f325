// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <functional>
#include <optional>
#include <string_view>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

/// Videos as rows of images. Frames count from 0 in the order in which they are shown.
namespace plumbline {

/// Whether a file's name ends as that of a video (.mp4, .avi, .mkv, .mov and others).
bool is_video(const std::filesystem::path& file);

/// A frame of a video by its path, "video.mp4#000120".
struct VideoFrame {
  std::filesystem::path video;
  int frame = 0;
};

/// "video.mp4" and 120 -> "video.mp4#000120": six digits, or as many as are needed.
std::filesystem::path frame_path(const std::filesystem::path& video, int frame);

/// The other way; nullopt for the path of anything else.
std::optional<VideoFrame> parse_frame_path(std::string_view path);

/// What one pass over a video tells.
struct VideoScan {
  ImageSize size;
  int frames_promised = 0;        ///< by the container, which may be wrong; 0: it says nothing
  std::vector<double> sharpness;  ///< of each frame that can be decoded
};

/// Decodes a whole video and measures how sharp each frame is: the mean squared gradient of its grey levels
/// ("Tenengrad": Krotkov 1987; Pertuz, Puig and Garcia 2013, GRA6) after reducing it to 1000 px of width or
/// less. One frame is in memory at a time. `progress` gets frames done, and those that the container promises
/// (0: unknown). Failures as read_photograph().
Result<VideoScan> scan_video(const std::filesystem::path& video,
                             const std::function<void(int, int)>& progress = nullptr);

/// The sharpest frame of each window of `every` frames, for videos that were taken together: the same frame
/// of all of them, the one whose worst sharpness among the videos (relative to the video's best in this
/// window) is best; the first of several. In a window where some videos have ended, the others alone. \param
/// sharpness  of each video's frames \returns the frames of each video, ascending \pre every > 0
std::vector<std::vector<int>> sharpest_frames(const std::vector<std::vector<double>>& sharpness, int every);

}  // namespace plumbline
