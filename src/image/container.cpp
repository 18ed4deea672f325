// SPDX-License-Identifier: Apache-2.0
#include "image/container.hpp"

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <limits>
#include <string_view>

namespace plumbline::detail {
namespace {

std::uint32_t big_endian(std::string_view bytes, std::size_t at, int n) {
  std::uint32_t value = 0;
  for (int i = 0; i < n; ++i)
    value = value << 8U | static_cast<unsigned char>(bytes[at + static_cast<std::size_t>(i)]);
  return value;
}

std::uint32_t little_endian(std::string_view bytes, std::size_t at, int n) {
  std::uint32_t value = 0;
  for (int i = n - 1; i >= 0; --i)
    value = value << 8U | static_cast<unsigned char>(bytes[at + static_cast<std::size_t>(i)]);
  return value;
}

/// Where the orientation's two bytes are in a TIFF's first directory (EXIF is such a file within the file).
std::optional<std::size_t> place_of_orientation(std::string_view tiff) {
  constexpr std::uint32_t kOrientation = 0x0112, kShort = 3;
  if (tiff.size() < 8) return std::nullopt;
  const bool is_little = tiff.starts_with(std::string_view("II*\0", 4));
  if (!is_little && !tiff.starts_with(std::string_view("MM\0*", 4))) return std::nullopt;
  const auto number = [&](std::size_t at, int n) {
    return is_little ? little_endian(tiff, at, n) : big_endian(tiff, at, n);
  };
  std::size_t at = number(4, 4);
  if (at + 2 > tiff.size()) return std::nullopt;
  const std::uint32_t n_entries = number(at, 2);
  at += 2;
  for (std::uint32_t i = 0; i < n_entries && at + 12 <= tiff.size(); ++i, at += 12) {
    if (number(at, 2) == kOrientation && number(at + 2, 2) == kShort) return at + 8;
  }
  return std::nullopt;
}

/// 1 where there is none.
int orientation_in_tiff(std::string_view tiff) {
  const auto at = place_of_orientation(tiff);
  if (!at) return 1;
  const std::uint32_t value = tiff[0] == 'I' ? little_endian(tiff, *at, 2) : big_endian(tiff, *at, 2);
  return value >= 1 && value <= 8 ? static_cast<int>(value) : 1;
}

constexpr std::string_view kExifMark{"Exif\0\0", 6};

int as_int(std::uint32_t value) {
  constexpr std::uint32_t kMax = std::numeric_limits<int>::max();
  return static_cast<int>(value > kMax ? kMax : value);
}

ContainerInfo inspect_png(const std::string& bytes) {
  ContainerInfo info{"PNG", std::nullopt, true, 1};
  for (std::size_t at = 8; at + 12 <= bytes.size();) {
    const std::uint32_t length = big_endian(bytes, at, 4);
    const std::string type = bytes.substr(at + 4, 4);
    if (type == "IHDR" && length >= 8 && at + 16 <= bytes.size()) {
      info.size = ImageSize{as_int(big_endian(bytes, at + 8, 4)), as_int(big_endian(bytes, at + 12, 4))};
    }
    if (type == "IEND") info.ends_early = false;
    if (type == "eXIf")
      info.orientation = orientation_in_tiff(std::string_view(bytes).substr(at + 8, length));
    if (type == "IEND" || length > bytes.size()) break;
    at += 12 + static_cast<std::size_t>(length);
  }
  return info;
}

bool is_frame_header(unsigned marker) {
  return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
}

ContainerInfo inspect_jpeg(const std::string& bytes) {
  ContainerInfo info{"JPEG", std::nullopt, true, 1};
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
    const std::string_view segment = std::string_view(bytes).substr(at + 4, length < 2 ? 0 : length - 2);
    if (marker == 0xE1 && segment.starts_with(kExifMark))
      info.orientation = orientation_in_tiff(segment.substr(kExifMark.size()));
    if (marker ==
        0xDA) {  // the picture itself: in it 0xFF is followed by 0 or a restart mark, so the end is unique
      info.ends_early = bytes.find("\xFF\xD9", at + 2 + length) == std::string::npos;
      break;
    }
    at += 2 + length;
  }
  return info;
}

ContainerInfo inspect_webp(std::string_view bytes) {
  ContainerInfo info{"WebP", std::nullopt, false, 1};
  for (std::size_t at = 12; at + 8 <= bytes.size();) {
    const std::size_t length = little_endian(bytes, at + 4, 4);
    if (bytes.substr(at, 4) == "EXIF") {
      std::string_view exif = bytes.substr(at + 8, length);
      if (exif.starts_with(kExifMark)) exif.remove_prefix(kExifMark.size());
      info.orientation = orientation_in_tiff(exif);
    }
    at += 8 + length + length % 2;
  }
  return info;
}

/// Binary PGM and PPM. OpenCV gives what is missing at their end as it finds its memory.
ContainerInfo inspect_pnm(std::string_view bytes) {
  ContainerInfo info{"PNM", std::nullopt, false, 1};
  std::size_t at = 2;
  std::uint64_t numbers[3] = {0, 0, 0};
  for (std::uint64_t& number : numbers) {
    while (at < bytes.size() && (std::isspace(static_cast<unsigned char>(bytes[at])) || bytes[at] == '#')) {
      if (bytes[at] == '#') at = std::min(bytes.find('\n', at), bytes.size() - 1);
      ++at;
    }
    if (at >= bytes.size() || !std::isdigit(static_cast<unsigned char>(bytes[at]))) return info;
    for (; at < bytes.size() && std::isdigit(static_cast<unsigned char>(bytes[at])); ++at)
      number = std::min<std::uint64_t>(10 * number + static_cast<std::uint64_t>(bytes[at] - '0'), 1U << 30U);
  }
  info.size = ImageSize{static_cast<int>(numbers[0]), static_cast<int>(numbers[1])};
  const std::uint64_t n_bytes =
      numbers[0] * numbers[1] * (numbers[2] > 255 ? 2 : 1) * (bytes[1] == '6' ? 3 : 1);
  info.ends_early = bytes.size() - at < 1 + n_bytes;
  return info;
}

}  // namespace

ContainerInfo inspect_container(const std::string& bytes) {
  const std::string_view view = bytes;
  if (bytes.starts_with("\x89PNG\r\n\x1a\n")) return inspect_png(bytes);
  if (bytes.starts_with("\xFF\xD8\xFF")) return inspect_jpeg(bytes);
  if (bytes.starts_with("II*") || bytes.starts_with("MM"))
    return {"TIFF", std::nullopt, false, orientation_in_tiff(bytes)};
  if (bytes.size() >= 12 && bytes.starts_with("RIFF") && view.substr(8, 4) == "WEBP")
    return inspect_webp(bytes);
  if (bytes.starts_with("P5") || bytes.starts_with("P6")) return inspect_pnm(bytes);
  if (bytes.size() >= 12 && view.substr(4, 4) == "ftyp") {
    const std::string_view brand = view.substr(8, 4);
    if (brand == "avif" || brand == "avis") return {"AVIF", std::nullopt, false, 1};
    for (const char* heic : {"heic", "heix", "mif1", "hevc", "msf1"}) {
      if (brand == heic) return {"HEIC", std::nullopt, false, 1};
    }
  }
  return {};
}

void set_upright(std::string& tiff) {
  const auto at = place_of_orientation(tiff);
  if (!at) return;
  const bool is_little = tiff[0] == 'I';
  tiff[*at] = is_little ? 1 : 0;
  tiff[*at + 1] = is_little ? 0 : 1;
}

}  // namespace plumbline::detail
