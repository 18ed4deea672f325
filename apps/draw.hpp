// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>

#include "args.hpp"

namespace plumbline::apps {

/// Pictures of what was found, and of what was not.
/// FOLDER/CAMERA/STEM.png: the image, enlarged until its corners stand clear of one another. A cross at each
/// corner with the number of its point, joined in their order by a line that runs from red (the first) to
/// blue (the last), so that a wrong numbering shows; around each a circle of its sigma, enlarged by a factor
/// that is the same for all images of a camera and stands in the legend below. FOLDER/contact_sheet.png: all
/// images small, framed by what became of them (contact_sheet.hpp). Several boards in one image are drawn
/// into one picture.
Status draw_detections(const std::vector<CameraImages>& images, const Dataset& data,
                       const std::filesystem::path& folder, const Common& common);

}  // namespace plumbline::apps
