// SPDX-License-Identifier: Apache-2.0
#include "image/video_stream.hpp"

#include <fmt/format.h>

#include <array>
#include <system_error>

#include "image/codec.hpp"

namespace plumbline::detail {
namespace fs = std::filesystem;

Result<VideoStream> VideoStream::open(const fs::path& file) {
  std::error_code failed;
  const fs::file_status status = fs::status(file, failed);
  const auto bad = [&](ErrorCode code, std::string why) {
    return Error{code, std::move(why), file.string()};
  };
  if (status.type() == fs::file_type::not_found) return bad(ErrorCode::kIo, "there is no such file");
  if (status.type() != fs::file_type::regular)
    return bad(ErrorCode::kIo, "this is no file, a video is needed");
  if (fs::file_size(file, failed) == 0) return bad(ErrorCode::kParse, "the file is empty, a video is needed");
  const Result<const VideoioApi*> codec = video_codec();
  if (!codec) return codec.error();
  VideoStream stream;
  stream.file_ = file;
  std::array<char, 512> message{};
  void* video = (*codec)->open(file.c_str(), &stream.facts_, message.data(), message.size());
  if (video == nullptr)
    return bad(ErrorCode::kParse, fmt::format("no video that can be decoded: {}", message.data()));
  stream.api_ = *codec;
  stream.video_ = std::shared_ptr<void>(video, (*codec)->close);
  return stream;
}

int VideoStream::orientation() const {
  switch (facts_.rotation_deg) {
    case 90:
      return 6;
    case 180:
      return 3;
    case 270:
      return 8;
    default:
      return 1;
  }
}

bool VideoStream::go_to(int frame) {
  PLUMBLINE_CHECK(frame >= at_, "a video goes forward only");
  for (; at_ < frame; ++at_) {
    if (!api_->next(video_.get())) return false;
  }
  return true;
}

Result<cv::Mat> VideoStream::pixels(bool grey) const {
  PLUMBLINE_CHECK(at_ >= 0, "go_to() first");
  cv::Mat image;
  std::array<char, 512> message{};
  if (api_->pixels(video_.get(), grey, &image, message.data(), message.size())) return image;
  return Error{ErrorCode::kParse, fmt::format("frame {} cannot be decoded: {}", at_, message.data()),
               file_.string()};
}

Result<Photograph> read_frame(VideoStream& video, const fs::path& path, int frame, ReadAs as) {
  if (!video.go_to(frame)) {
    return Error{ErrorCode::kParse, "the video ends before this frame, or cannot be decoded up to it",
                 path.string()};
  }
  auto pixels = video.pixels(as == ReadAs::kGrey8);
  if (!pixels) return pixels.error();
  return Photograph{*std::move(pixels), video.orientation()};
}

}  // namespace plumbline::detail
