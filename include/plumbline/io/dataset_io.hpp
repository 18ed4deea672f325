// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/rig/dataset.hpp"

namespace plumbline {

/// corners.yaml: target, cameras, views; the corners of a view are one block of text, a line `point x y
/// sigma` each. (a list of lists is read too). Every number has the digits that it takes: parse_corners gives
/// the same Dataset back. kParse names the field and its line, kInvalidData is what validate() says,
/// kUnsupported a newer version. \pre validate(data) holds, and frames have distinct names
std::string format_corners(const Dataset& data);
Result<Dataset> parse_corners(std::string_view yaml);

/// One image of a mrcal corners file. Points are in file order; absent ones have no corner.
struct VnlImage {
  std::string filename;
  std::vector<Corner> corners;  ///< point = position in the image's list; level L gives sigma_px = 2^L
  int n_rows = 0;               ///< rows of this image, seen or not; 1 where a lone `- - -` says: no board
};

/// mrcal's corners.vnl: a legend `# filename x y level` (or `weight`, or neither; columns in any order), then
/// a row per point. Sigma is 2^level, or 1/weight, or 1 px. As in mrcal, a row with '-' or a negative pixel,
/// a negative level or a weight that is not positive is a point that was not seen, and a lone `filename - -
/// -` an image without a board. kParse names the line.
Result<std::vector<VnlImage>> parse_vnl(std::string_view text);

/// The views of one camera as corners.vnl with a level column (mrcal's tools take any fourth column for one);
/// points that were not seen are written `- - -`. The level is log2(sigma), rounded, relative to the finest
/// sigma where that is below 1 px. Blanks in file names become '_', because the format cannot hold them. \pre
/// validate(data) holds
std::string format_vnl(const Dataset& data, int cam);

}  // namespace plumbline
