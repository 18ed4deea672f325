// SPDX-License-Identifier: Apache-2.0
#include "plumbline/image/image.hpp"

#include <fmt/format.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <system_error>

#include "image/codec.hpp"
#include "image/container.hpp"
#include "image/video_stream.hpp"
#include "plumbline/image/video.hpp"

namespace plumbline {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMaxFileBytes = 1U << 30U;          ///< no photograph is larger; a wrong file may be
constexpr std::int64_t kMaxPixels = std::int64_t{1} << 28U;  ///< 268 Mpx: 0.8 GB as BGR

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using FilePtr = std::unique_ptr<std::FILE, CloseFile>;

Error io_error(const fs::path& file, const std::string& message) {
  return {ErrorCode::kIo, message, file.string()};
}

Result<std::string> read_bytes(const fs::path& file) {
  std::error_code failed;
  const fs::file_status status = fs::status(file, failed);
  if (status.type() == fs::file_type::not_found) return io_error(file, "there is no such file");
  if (fs::is_directory(status)) return io_error(file, "this is a folder, an image file is needed");
  const FilePtr in(std::fopen(file.c_str(), "rb"));
  if (!in) return io_error(file, fmt::format("cannot be opened: {}", std::strerror(errno)));
  std::string bytes;
  std::array<char, 1 << 16> block;
  while (const std::size_t n = std::fread(block.data(), 1, block.size(), in.get())) {
    bytes.append(block.data(), n);
    if (bytes.size() > kMaxFileBytes)
      return io_error(file, fmt::format("larger than {} bytes: not an image", kMaxFileBytes));
  }
  if (std::ferror(in.get()) != 0)
    return io_error(file, fmt::format("cannot be read: {}", std::strerror(errno)));
  return bytes;
}

Status check_container(const detail::ContainerInfo& info, std::size_t n_bytes, const fs::path& file) {
  const auto bad = [&](const std::string& why) { return Error{ErrorCode::kParse, why, file.string()}; };
  if (info.size && static_cast<std::int64_t>(info.size->width) * info.size->height > kMaxPixels) {
    return bad(fmt::format("{}x{} pixels are more than the {} that are read", info.size->width,
                           info.size->height, kMaxPixels));
  }
  if (info.ends_early) {
    return bad(
        fmt::format("the {} stops after {} bytes, before its end: copy the file again", info.kind, n_bytes));
  }
  if (info.kind == "HEIC" || info.kind == "AVIF")
    return bad(fmt::format("{} photographs cannot be decoded: save it as JPEG or PNG", info.kind));
  return {};
}

/// OpenCV's decoders give 1 or 3 channels when asked so, but for some that ignore it.
cv::Mat without_alpha(const cv::Mat& image) {
  if (image.channels() == 1 || image.channels() == 3) return image;
  const bool is_grey = image.channels() == 2;
  cv::Mat out(image.size(), CV_MAKETYPE(image.depth(), is_grey ? 1 : 3));
  constexpr std::array<int, 6> kSame{0, 0, 1, 1, 2, 2};
  cv::mixChannels(&image, 1, &out, 1, kSame.data(), is_grey ? 1 : 3);
  return out;
}

Result<Photograph> decode(const fs::path& file, ReadAs as) {
  Result<std::string> bytes = read_bytes(file);
  if (!bytes) return bytes.error();
  const auto bad = [&](const std::string& why) { return Error{ErrorCode::kParse, why, file.string()}; };
  if (bytes->empty()) return bad("the file is empty, an image is needed");
  const detail::ContainerInfo info = detail::inspect_container(*bytes);
  if (Status ok = check_container(info, bytes->size(), file); !ok) return ok.error();
  // OpenCV's decoder of TIFF turns the pixels whatever it is told.
  if (info.kind == "TIFF") detail::set_upright(*bytes);
  const Result<const detail::ImageioApi*> codec = detail::image_codec();
  if (!codec) return codec.error();
  Photograph photograph{{}, info.orientation};
  cv::Mat& image = photograph.pixels;
  std::array<char, 512> message{};
  const auto* data = reinterpret_cast<const unsigned char*>(bytes->data());
  const bool grey = as == ReadAs::kGrey8;
  if (!(*codec)->decode(data, bytes->size(), grey, &image, message.data(), message.size())) {
    return bad(fmt::format("no image that can be decoded ({} bytes): {}", bytes->size(), message.data()));
  }
  image = without_alpha(image);
  if (grey || image.depth() != CV_16U) image = to_8bit(image);
  return photograph;
}

}  // namespace

Result<Photograph> read_photograph(const fs::path& file, ReadAs as) {
  if (const auto frame = parse_frame_path(file.string())) {
    auto video = detail::VideoStream::open(frame->video);
    if (!video) return video.error();
    return detail::read_frame(*video, file, frame->frame, as);
  }
  if (is_video(file)) {
    return Error{ErrorCode::kUnsupported,
                 fmt::format("this is a video, an image is needed: {} is its first frame",
                             frame_path(file.filename(), 0).string()),
                 file.string()};
  }
  return decode(file, as);
}

Result<cv::Mat> read_image_grey(const fs::path& file) {
  auto photograph = read_photograph(file, ReadAs::kGrey8);
  if (!photograph) return photograph.error();
  return photograph->pixels;
}

Result<cv::Mat> read_image(const fs::path& file) {
  auto photograph = read_photograph(file, ReadAs::kStored);
  if (!photograph) return photograph.error();
  return photograph->pixels;
}

Status write_png(const fs::path& file, const cv::Mat& image) {
  PLUMBLINE_CHECK(!image.empty() && (image.depth() == CV_8U || image.depth() == CV_16U),
                  "an 8- or 16-bit image is needed");
  const Result<const detail::ImageioApi*> codec = detail::image_codec();
  if (!codec) return codec.error();
  cv::Mat bytes;
  std::array<char, 512> message{};
  if (!(*codec)->encode_png(&image, &bytes, message.data(), message.size())) {
    return Error{ErrorCode::kInvalidData, fmt::format("cannot be written as PNG: {}", message.data()),
                 file.string()};
  }
  // Beside the file and renamed, so that a full disc leaves neither half a file nor destroys an earlier one.
  fs::path part = file;
  part += ".part";
  FilePtr out(std::fopen(part.c_str(), "wb"));
  if (!out) return io_error(file, fmt::format("cannot be created: {}", std::strerror(errno)));
  const bool written = std::fwrite(bytes.data, 1, bytes.total(), out.get()) == bytes.total();
  const bool closed = std::fclose(out.release()) == 0;
  std::error_code failed;
  if (written && closed) fs::rename(part, file, failed);
  if (!written || !closed || failed) {
    const std::string why = failed ? failed.message() : std::strerror(errno);
    fs::remove(part, failed);
    return io_error(file, fmt::format("cannot be written: {}", why));
  }
  return {};
}

}  // namespace plumbline
