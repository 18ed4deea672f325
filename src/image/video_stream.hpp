// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <memory>

#include "image/imageio_api.hpp"
#include "plumbline/image/image.hpp"

namespace plumbline::detail {

/// A video that is decoded from its beginning, frame by frame: the only way that is exact for every container
/// and for frames of unequal length. Not thread-safe.
class VideoStream {
 public:
  /// Failures as read_photograph().
  static Result<VideoStream> open(const std::filesystem::path& file);

  const VideoioApi::Facts& facts() const { return facts_; }
  /// EXIF's number for the turn that the container asks for.
  int orientation() const;
  /// Goes on to a frame; false when the video ends before it. \pre not before the frame it is at
  bool go_to(int frame);
  /// The pixels of the frame it is at.
  Result<cv::Mat> pixels(bool grey) const;

 private:
  std::filesystem::path file_;
  VideoioApi::Facts facts_;
  const VideoioApi* api_ = nullptr;
  std::shared_ptr<void> video_;  ///< the module's decoder
  int at_ = -1;
};

/// One frame, as read_photograph() gives it.
Result<Photograph> read_frame(VideoStream& video, const std::filesystem::path& path, int frame, ReadAs as);

}  // namespace plumbline::detail
