// SPDX-License-Identifier: Apache-2.0
#include "png.hpp"

#include <cmath>
#include <cstdint>
#include <string_view>

namespace plumbline::detail {
namespace {

std::string big_endian(std::uint32_t value) {
  std::string bytes;
  for (int shift = 24; shift >= 0; shift -= 8) bytes.push_back(static_cast<char>((value >> shift) & 0xff));
  return bytes;
}

// The CRC of PNG chunks (PNG specification, annex D), bit by bit: nine bytes need no table.
std::uint32_t crc(std::string_view bytes) {
  std::uint32_t c = 0xffffffffu;
  for (const char byte : bytes) {
    c ^= static_cast<unsigned char>(byte);
    for (int k = 0; k < 8; ++k) c = (c & 1) ? 0xedb88320u ^ (c >> 1) : c >> 1;
  }
  return c ^ 0xffffffffu;
}

}  // namespace

std::string png_with_dpi(const std::string& png, int dpi) {
  const auto per_metre = static_cast<std::uint32_t>(std::lround(dpi / 0.0254));
  const std::string body =
      "pHYs" + big_endian(per_metre) + big_endian(per_metre) + '\1';  // 1: the unit is the metre
  // The signature (8 bytes) and the header chunk (25) come first; pHYs must stand before the image data.
  constexpr std::size_t kHeader = 33;
  return png.substr(0, kHeader) + big_endian(9) + body + big_endian(crc(body)) + png.substr(kHeader);
}

}  // namespace plumbline::detail
