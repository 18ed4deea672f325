// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>

#include "args.hpp"

namespace plumbline::apps {

/// Every image with the corners that were found drawn into it, as FOLDER/CAMERA/STEM.png: a cross at each
/// corner, joined in the order of the points by a line that runs from red (the first) to blue (the last), so
/// that a wrong numbering shows.
Status write_overlays(const std::vector<CameraImages>& images, const Dataset& data,
                      const std::filesystem::path& folder, const Common& common);

}  // namespace plumbline::apps
