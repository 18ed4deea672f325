// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <string>

#include "io/formats/common.hpp"

/// What cameras.txt and COLMAP's whole model share.
namespace plumbline::io {

constexpr double kColmapPixelShift = 0.5;  ///< COLMAP's pixel minus ours

/// "ID MODEL WIDTH HEIGHT PARAMS[]" and a line break; kUnsupported names the lens.
Result<std::string> colmap_camera_line(std::int64_t id, const Camera& camera);

}  // namespace plumbline::io
