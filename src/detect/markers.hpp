// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstdint>
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
};

/// ArUco markers of OpenCV's dictionary ("4X4_50"), clockwise from the marker's own top left. `expected` is
/// how many the boards have: when fewer than half of them are found, smaller and larger thresholding windows
/// are tried, then the negative of the image (boards printed white on black). Unrefined corners, good to
/// about a pixel. `border_bits`: width of the black border in modules.
std::vector<Marker> find_aruco(const cv::Mat& grey, std::string_view dictionary, int expected,
                               int border_bits = 1);

/// The codes of an ArUco dictionary of OpenCV's, in the four turns in which a marker may be seen.
struct MarkerCodes {
  int modules = 0;  ///< of a side, without the border
  /// [id][turn]: bit y * modules + x says that the module at (x, y) is white. A place (x, y) as seen is
  /// (modules - 1 - y, x) on the marker after one turn.
  std::vector<std::array<std::uint64_t, 4>> code;
};
MarkerCodes marker_codes(std::string_view dictionary);

/// Tags of family 36h11 with a border two modules wide (Kalibr's boards), in Kalibr's order: bottom left,
/// bottom right, top right, top left. One id may come several times: five ways of looking are united
/// (docs/detect.md).
std::vector<Marker> find_april_tags(const cv::Mat& grey);

}  // namespace plumbline::detail
