// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/rig/dataset.hpp"

namespace plumbline {

/// corners.yaml: target, cameras, views; the corners of a view are one block of text, a line `point x y
/// sigma` each.
std::string format_corners(const Dataset& data);
Result<Dataset> parse_corners(std::string_view yaml);

/// One image of a mrcal corners file. Points are in file order; absent ones have no corner.
struct VnlImage {
  std::string filename;
  std::vector<Corner> corners;  ///< point = position in the image's list; level L gives sigma_px = 2^L
};

/// mrcal's corners.vnl (`# filename x y level`, or `weight`). A line `filename - - -` is an image without a
/// board. kParse names the line.
Result<std::vector<VnlImage>> parse_vnl(std::string_view text);

/// The views of one camera as corners.vnl; points that were not seen are written `- - -`.
std::string format_vnl(const Dataset& data, int cam);

}  // namespace plumbline
