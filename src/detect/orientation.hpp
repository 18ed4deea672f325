// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace plumbline::detail {

/// What is to be said of the orientation tags (EXIF 1..8) of a camera's images, "12 of 13 images carry EXIF
/// orientation 6 (to be turned by 90 degrees clockwise); pixels are used as stored": nullopt when none
/// carries one that turns the picture. Where they differ, each value's count and one image are named.
std::optional<std::string> orientation_note(std::span<const int> orientations,
                                            const std::vector<std::string>& names);

}  // namespace plumbline::detail
