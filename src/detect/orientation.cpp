// SPDX-License-Identifier: Apache-2.0
#include "detect/orientation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "plumbline/core/text.hpp"

namespace plumbline::detail {
namespace {

/// How a viewer has to turn what is stored (CIPA DC-008, tag 0x0112).
const char* turn_of(int orientation) {
  constexpr const char* kTurns[] = {"",
                                    "upright",
                                    "to be mirrored left to right",
                                    "to be turned by 180 degrees",
                                    "to be mirrored top to bottom",
                                    "to be mirrored along the falling diagonal",
                                    "to be turned by 90 degrees clockwise",
                                    "to be mirrored along the rising diagonal",
                                    "to be turned by 270 degrees clockwise"};
  return kTurns[std::clamp(orientation, 1, 8)];
}

}  // namespace

std::optional<std::string> orientation_note(std::span<const int> orientations,
                                            const std::vector<std::string>& names) {
  std::map<int, std::vector<std::size_t>> images;
  for (std::size_t i = 0; i < orientations.size(); ++i) images[orientations[i]].push_back(i);
  if (images.size() == 1 && images.contains(1)) return std::nullopt;
  const auto counted = [&](int orientation) {
    return fmt::format("{} of {} images {} EXIF orientation {} ({})", images[orientation].size(),
                       orientations.size(), images[orientation].size() == 1 ? "carries" : "carry",
                       orientation, turn_of(orientation));
  };
  const std::size_t n_turned = images.size() - (images.contains(1) ? 1 : 0);
  if (n_turned == 1)
    return counted(images.rbegin()->first) + "; pixels are used as stored" +
           (images.size() == 1 ? "" : fmt::format(", also in the others ({} is one)", names[images[1][0]]));
  std::vector<std::string> parts;
  for (const auto& [orientation, which] : images)
    parts.push_back(fmt::format("{}, {} is one", counted(orientation), names[which[0]]));
  return join(parts, "; ") +
         ": the camera was turned between the images, and pixels are used as stored in all of them";
}

}  // namespace plumbline::detail
