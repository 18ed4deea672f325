// SPDX-License-Identifier: Apache-2.0
#include "image/container.hpp"

#include <cstdint>
#include <limits>

namespace plumbline::detail {
namespace {

std::uint32_t big_endian(const std::string& bytes, std::size_t at, int n) {
  std::uint32_t value = 0;
  for (int i = 0; i < n; ++i)
    value = value << 8U | static_cast<unsigned char>(bytes[at + static_cast<std::size_t>(i)]);
  return value;
}

int as_int(std::uint32_t value) {
  constexpr std::uint32_t kMax = std::numeric_limits<int>::max();
  return static_cast<int>(value > kMax ? kMax : value);
}

ContainerInfo inspect_png(const std::string& bytes) {
  ContainerInfo info{"PNG", std::nullopt, true};
  for (std::size_t at = 8; at + 12 <= bytes.size();) {
    const std::uint32_t length = big_endian(bytes, at, 4);
    const std::string type = bytes.substr(at + 4, 4);
    if (type == "IHDR" && length >= 8 && at + 16 <= bytes.size()) {
      info.size = ImageSize{as_int(big_endian(bytes, at + 8, 4)), as_int(big_endian(bytes, at + 12, 4))};
    }
    if (type == "IEND") info.ends_early = false;
    if (type == "IEND" || length > bytes.size()) break;
    at += 12 + static_cast<std::size_t>(length);
  }
  return info;
}

bool is_frame_header(unsigned marker) {
  return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
}

ContainerInfo inspect_jpeg(const std::string& bytes) {
  ContainerInfo info{"JPEG", std::nullopt, true};
  std::size_t at = 2;
  while (at + 4 <= bytes.size()) {
    if (static_cast<unsigned char>(bytes[at]) != 0xFF) break;
    const unsigned marker = static_cast<unsigned char>(bytes[at + 1]);
    if (marker == 0xFF) {  // a fill byte
      ++at;
      continue;
    }
    const std::size_t length = big_endian(bytes, at + 2, 2);
    if (is_frame_header(marker) && at + 9 <= bytes.size()) {
      info.size = ImageSize{as_int(big_endian(bytes, at + 7, 2)), as_int(big_endian(bytes, at + 5, 2))};
    }
    if (marker ==
        0xDA) {  // the picture itself: in it 0xFF is followed by 0 or a restart mark, so the end is unique
      info.ends_early = bytes.find("\xFF\xD9", at + 2 + length) == std::string::npos;
      break;
    }
    at += 2 + length;
  }
  return info;
}

}  // namespace

ContainerInfo inspect_container(const std::string& bytes) {
  if (bytes.starts_with("\x89PNG\r\n\x1a\n")) return inspect_png(bytes);
  if (bytes.starts_with("\xFF\xD8\xFF")) return inspect_jpeg(bytes);
  return {};
}

}  // namespace plumbline::detail
