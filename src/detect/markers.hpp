// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string_view>
#include <vector>

#include "plumbline/core/types.hpp"

namespace plumbline::detail {

/// A square marker as a detector saw it; pixel centres at integers.
struct Marker {
  int id = -1;
  std::array<Vec2, 4> px;  ///< order as the function that made it says
  int border = 0;          ///< modules, where it was recognised
};

/// The codes of an ArUco dictionary of OpenCV's, in the four turns in which a marker may be seen.
struct MarkerCodes {
  int modules = 0;  ///< of a side, without the border
  /// [id][turn]: bit y * modules + x says that the module at (x, y) is white. A place (x, y) as seen is
  /// (modules - 1 - y, x) on the marker after one turn.
  std::vector<std::array<std::uint64_t, 4>> code;
};
MarkerCodes marker_codes(std::string_view dictionary);

/// AprilTags ("36h11", "25h9") whose corners touch small black squares, in Kalibr's order: bottom left,
/// bottom right, top right, top left. They are read in the dark fields between saddles, in the image's halves
/// first; after each size is_enough says whether to stop. One id may come several times. Borders of one and
/// of two modules are read; `border` is tried first. `n_tags`: on the boards looked for. Corners are good to
/// about a pixel of the size in which they were found.
std::vector<Marker> find_april_tags(const cv::Mat& grey, std::string_view family, int border, int n_tags,
                                    const std::function<bool(const std::vector<Marker>&)>& is_enough);

}  // namespace plumbline::detail
