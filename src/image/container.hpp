// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>

#include "plumbline/core/types.hpp"

namespace plumbline::detail {

/// What can be said of an encoded image without decoding it.
struct ContainerInfo {
  std::string kind;               ///< "PNG", "JPEG", or "" for any other
  std::optional<ImageSize> size;  ///< where it was found
  bool ends_early = false;  ///< the file stops before its end mark: OpenCV would fill the rest with grey
};

/// Walks the chunks of a PNG or the segments of a JPEG.
ContainerInfo inspect_container(const std::string& bytes);

}  // namespace plumbline::detail
