// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string_view>
#include <vector>

#include "plumbline/core/result.hpp"

namespace plumbline::detail {

/// The n x n modules of a marker with its border, row by row from the top left as the marker is seen upright.
struct Modules {
  int n = 0;
  std::vector<char> black;  ///< n * n
  bool at(int row, int column) const { return black[static_cast<std::size_t>(row * n + column)] != 0; }
};

/// Marker `id` of an OpenCV dictionary ("4X4_50") with its border of one module. kInvalidData: no such
/// dictionary or id.
Result<Modules> aruco_modules(std::string_view dictionary, int id);

/// Tag `id` of the AprilTag library's family ("36h11", "25h9") with a border of one or (Kalibr) two modules.
/// kInvalidData: no such family or id.
Result<Modules> april_modules(std::string_view family, int id, int border);

}  // namespace plumbline::detail
