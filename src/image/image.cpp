// SPDX-License-Identifier: Apache-2.0
#include "plumbline/image/image.hpp"

#include <fmt/format.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <system_error>

#include "image/codec.hpp"
#include "image/container.hpp"

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

Result<cv::Mat> decode(const fs::path& file, bool grey) {
  Result<std::string> bytes = read_bytes(file);
  if (!bytes) return bytes.error();
  const auto bad = [&](const std::string& why) { return Error{ErrorCode::kParse, why, file.string()}; };
  if (bytes->empty()) return bad("the file is empty, an image is needed");
  const detail::ContainerInfo info = detail::inspect_container(*bytes);
  if (info.size && static_cast<std::int64_t>(info.size->width) * info.size->height > kMaxPixels) {
    return bad(fmt::format("{}x{} pixels are more than the {} that are read", info.size->width,
                           info.size->height, kMaxPixels));
  }
  if (info.ends_early) {
    return bad(fmt::format("the {} stops after {} bytes, before its end: copy the file again", info.kind,
                           bytes->size()));
  }
  const Result<const detail::ImageioApi*> codec = detail::image_codec();
  if (!codec) return codec.error();
  cv::Mat image;
  std::array<char, 512> message{};
  const auto* data = reinterpret_cast<const unsigned char*>(bytes->data());
  if (!(*codec)->decode(data, bytes->size(), grey, &image, message.data(), message.size())) {
    return bad(fmt::format("no image that can be decoded ({} bytes): {}", bytes->size(), message.data()));
  }
  return image;
}

}  // namespace

Result<cv::Mat> read_image_grey(const fs::path& file) { return decode(file, true); }

Result<cv::Mat> read_image(const fs::path& file) { return decode(file, false); }

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
