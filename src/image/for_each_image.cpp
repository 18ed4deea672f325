// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "image/video_stream.hpp"
#include "plumbline/core/parallel.hpp"
#include "plumbline/image/video.hpp"

namespace plumbline {
namespace {

namespace fs = std::filesystem;

/// The frames that are wanted of one video, handed out in ascending order to whichever thread comes next.
class FrameQueue {
 public:
  void want(int frame, int index) { wanted_.push_back({frame, index}); }
  void sort() { std::sort(wanted_.begin(), wanted_.end()); }

  struct Next {
    int index;
    Result<Photograph> photograph;
  };
  Next next(const std::vector<fs::path>& files, ReadAs as) {
    const std::lock_guard hold(lock_);
    const auto [frame, index] = wanted_[n_taken_++];
    const fs::path& path = files[static_cast<std::size_t>(index)];
    if (!stream_) stream_ = detail::VideoStream::open(parse_frame_path(path.string())->video);
    Next result{index, *stream_ ? detail::read_frame(**stream_, path, frame, as) : stream_->error()};
    if (n_taken_ == wanted_.size()) stream_.reset();
    return result;
  }

 private:
  std::mutex lock_;
  std::vector<std::pair<int, int>> wanted_;  ///< frame, index of its path
  std::size_t n_taken_ = 0;
  std::optional<Result<detail::VideoStream>> stream_;
};

}  // namespace

void for_each_image(const std::vector<fs::path>& files, ReadAs as, int n_threads,
                    const std::function<void(int, const Result<Photograph>&)>& body) {
  std::map<fs::path, FrameQueue> videos;
  std::vector<FrameQueue*> queue_of(files.size(), nullptr);
  for (std::size_t i = 0; i < files.size(); ++i) {
    const auto frame = parse_frame_path(files[i].string());
    if (!frame) continue;
    queue_of[i] = &videos[frame->video];
    queue_of[i]->want(frame->frame, static_cast<int>(i));
  }
  for (auto& [video, queue] : videos) queue.sort();
  parallel_for(static_cast<int>(files.size()), n_threads, [&](int i) {
    if (FrameQueue* queue = queue_of[static_cast<std::size_t>(i)]) {
      const FrameQueue::Next next = queue->next(files, as);
      body(next.index, next.photograph);
    } else {
      body(i, read_photograph(files[static_cast<std::size_t>(i)], as));
    }
  });
}

}  // namespace plumbline
