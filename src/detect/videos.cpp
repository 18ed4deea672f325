// SPDX-License-Identifier: Apache-2.0
#include "plumbline/image/video.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <optional>

#include "plumbline/core/parallel.hpp"
#include "plumbline/detect/detect.hpp"

namespace plumbline {
namespace {

/// A video among the files of the cameras.
struct Video {
  std::size_t cam = 0, image = 0;
  std::optional<Result<VideoScan>> scan;
  std::vector<int> frames;  ///< that are taken
};

std::vector<Video> videos_of(const std::vector<CameraImages>& cameras) {
  std::vector<Video> videos;
  for (std::size_t cam = 0; cam < cameras.size(); ++cam) {
    for (std::size_t i = 0; i < cameras[cam].files.size(); ++i) {
      if (is_video(cameras[cam].files[i])) videos.push_back({cam, i, std::nullopt, {}});
    }
  }
  return videos;
}

/// Scans all of them, as many at once as there are threads.
Status scan_all(const std::vector<CameraImages>& cameras, const VideoOptions& options,
                std::vector<Video>& videos) {
  std::mutex lock;
  std::vector<int> done(videos.size(), 0), promised(videos.size(), 0);
  parallel_for(static_cast<int>(videos.size()), options.n_threads, [&](int v) {
    const auto at = static_cast<std::size_t>(v);
    const auto report = [&](int frames, int all) {
      const std::lock_guard hold(lock);
      done[at] = frames;
      promised[at] = std::max(all, frames);
      int n_done = 0, n_all = 0;
      for (std::size_t i = 0; i < videos.size(); ++i) n_done += done[i], n_all += promised[i];
      options.progress(n_done, n_all);
    };
    const auto progress = options.progress ? std::function<void(int, int)>(report) : nullptr;
    videos[at].scan = scan_video(cameras[videos[at].cam].files[videos[at].image], progress);
  });
  for (const Video& video : videos) {
    if (!*video.scan) {
      const Error& error = video.scan->error();
      return Error{error.code, error.message, cameras[video.cam].names[video.image]};
    }
  }
  return {};
}

/// The container of a whole video promises about what it holds (some reckon it from the duration); a cut one
/// promises more.
std::optional<std::string> cut_note(const std::string& name, const VideoScan& scan) {
  const int n = static_cast<int>(scan.sharpness.size()), missing = scan.frames_promised - n;
  if (missing <= std::max(2, scan.frames_promised / 10)) return std::nullopt;
  return fmt::format("{} promises {} frames, of which {} can be decoded: it may be cut or damaged", name,
                     scan.frames_promised, n);
}

CameraImages with_frames(const CameraImages& camera, std::size_t cam, const std::vector<Video>& videos,
                         bool by_number, int every) {
  CameraImages out{camera.camera, {}, {}, {}, camera.notes};
  for (std::size_t i = 0; i < camera.files.size(); ++i) {
    const auto video = std::find_if(videos.begin(), videos.end(),
                                    [&](const Video& v) { return v.cam == cam && v.image == i; });
    if (video == videos.end()) {
      out.files.push_back(camera.files[i]);
      out.names.push_back(camera.names[i]);
      out.frames.push_back(camera.frames[i]);
      continue;
    }
    const VideoScan& scan = **video->scan;
    out.notes.push_back(fmt::format("{}: {} frames, the sharpest of every {} taken: {}", camera.names[i],
                                    scan.sharpness.size(), every, video->frames.size()));
    if (auto note = cut_note(camera.names[i], scan)) out.notes.push_back(*std::move(note));
    for (const int frame : video->frames) {
      out.files.push_back(frame_path(camera.files[i], frame));
      out.names.push_back(frame_path(camera.names[i], frame).string());
      out.frames.push_back((by_number ? "" : camera.frames[i] + "/") + fmt::format("{:06d}", frame));
    }
  }
  return out;
}

}  // namespace

Result<std::vector<CameraImages>> sample_videos(std::vector<CameraImages> cameras,
                                                const VideoOptions& options) {
  PLUMBLINE_CHECK(options.every > 0, "a window has a frame at least");
  std::vector<Video> videos = videos_of(cameras);
  if (videos.empty()) return cameras;
  if (Status ok = scan_all(cameras, options, videos); !ok) return ok.error();
  const bool by_number = std::all_of(cameras.begin(), cameras.end(), [](const CameraImages& camera) {
    return camera.files.size() == 1 || std::none_of(camera.files.begin(), camera.files.end(), is_video);
  });
  std::map<std::string, std::vector<Video*>> together;
  for (Video& video : videos)
    together[by_number ? "" : cameras[video.cam].frames[video.image]].push_back(&video);
  for (auto& [key, of_key] : together) {
    std::vector<std::vector<double>> sharpness;
    for (const Video* video : of_key) sharpness.push_back((*video->scan)->sharpness);
    auto frames = sharpest_frames(sharpness, options.every);
    for (std::size_t i = 0; i < of_key.size(); ++i) of_key[i]->frames = std::move(frames[i]);
  }
  std::vector<CameraImages> out;
  for (std::size_t cam = 0; cam < cameras.size(); ++cam)
    out.push_back(with_frames(cameras[cam], cam, videos, by_number, options.every));
  return out;
}

}  // namespace plumbline
