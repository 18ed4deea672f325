// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>

#include "plumbline/core/types.hpp"

namespace plumbline::detail {

/// What can be said of an encoded image without decoding it.
struct ContainerInfo {
  std::string kind;               ///< "PNG", "JPEG", "TIFF", "WebP", "PNM", "HEIC", "AVIF", or "" for others
  std::optional<ImageSize> size;  ///< where it was found
  bool ends_early = false;  ///< the file stops before its end mark: OpenCV would fill the rest with grey
  int orientation = 1;      ///< EXIF's tag 0x0112; 1 where there is none
};

/// Walks the chunks of a PNG or a WebP, the segments of a JPEG, the first directory of a TIFF, or the header
/// of a PGM or PPM.
ContainerInfo inspect_container(const std::string& bytes);

/// Makes a TIFF's orientation 1, where it has one.
void set_upright(std::string& tiff);

}  // namespace plumbline::detail
