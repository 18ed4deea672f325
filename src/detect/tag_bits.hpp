// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string_view>
#include <vector>

#include "plumbline/core/types.hpp"

/// The bits of square markers, read from grey levels through a known map; for AprilTags and ArUco markers
/// alike.
namespace plumbline::detail {

/// The codes of a family of markers.
struct TagBook {
  int n = 0;         ///< modules of a side, without the border; n * n <= 64
  int distance = 0;  ///< least number of modules in which two codes, turned or not, differ
  /// Bit r * n + c is set where the module in row r and column c, from the top left of the upright marker, is
  /// white.
  std::vector<std::uint64_t> codes;
};

/// The AprilTag library's family "36h11" or "25h9"; nullptr: no such family. Made once.
const TagBook* april_book(std::string_view family);

/// Modules that may be read wrong: two fewer than could be put right, so that other things seldom are taken
/// for tags.
inline int most_errors(const TagBook& book) { return (book.distance - 1) / 2 - 2; }

/// Mean grey levels of n x n modules, with the border. A module is not known where a part of it lies outside
/// of the image.
struct TagCells {
  int n = 0;
  std::vector<float> grey;      ///< row by row
  std::vector<char> is_inside;  ///< of the image
};

/// H maps the marker's square, (0, 0) at one corner and (1, 1) at the opposite one with the border in it, to
/// pixels; rows run along its second coordinate.
TagCells read_cells(const cv::Mat& grey, const Mat3& H, int n);

/// Which modules are white: the border gives the dark level as a plane over the marker (light that changes),
/// what stands out of it is parted in two levels. nullopt: the border is not dark, or there is no second
/// level.
struct TagBits {
  int n = 0;                    ///< without the border
  std::uint64_t white = 0;      ///< as in TagBook
  std::uint64_t is_inside = 0;  ///< modules that are known
  double contrast = 0;          ///< between the levels [grey levels], which are sharpened
};
std::optional<TagBits> threshold_cells(const TagCells& cells, int border);

/// The code nearest to what was read.
struct TagReading {
  int id = -1;
  int turn = 0;    ///< quarter turns: (r, c) of the upright marker was read at (c, n - 1 - r) for one turn
  int errors = 0;  ///< known modules that differ
  int next = 0;    ///< of the second nearest code or turn
};
TagReading match_code(const TagBits& bits, const TagBook& book);

/// Known modules in which the bits differ from code `id` under that turn.
int count_errors(const TagBits& bits, const TagBook& book, int id, int turn);

}  // namespace plumbline::detail
