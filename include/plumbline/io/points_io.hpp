// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

namespace plumbline {

/// Numbers in named columns: points of the world (X, Y, Z), pixels (u, v), pixels of several views (u1, v1,
/// u2, v2, ...), or whatever else a file names. Units are the file's; pixel (0, 0) is the centre of the
/// top-left pixel.
struct PointTable {
  std::vector<std::string> columns;         ///< names in the order of the file, all different
  std::vector<std::vector<double>> values;  ///< values[column][row]; NaN where the file has '-': not known
  std::vector<int> lines;                   ///< line of each row in the file, from 1

  std::size_t n_rows() const { return lines.size(); }
  std::optional<std::size_t> find(std::string_view column) const;
};

/// A table from text: CSV with a header of names, or YAML with `columns: [X, Y, Z, u, v]` and `rows:`, a list
/// of lists or a block with a row per line. Cells of a CSV are separated by commas where the header has one,
/// by white space otherwise. '#' begins a remark; where no row of names stands before the numbers, the last
/// remark before them is the header (as numpy.savetxt writes it). '-' is a value that is not known.
/// \returns kParse with the line for anything else: a ragged row, a cell that is no finite number (NaN,
///          infinity, text), a name that occurs twice or is none ([A-Za-z_][A-Za-z0-9_.]*), no header, no
///          row; text over 64 MiB, more than 1000 columns or ten million values
Result<PointTable> parse_points(std::string_view text);

/// As CSV, 17 digits: parse_points gives the same table back.
std::string format_points(const PointTable& table);

/// The points of two columns [px]. kInvalidData names a column that is missing and those that there are, or
/// the line of a value that is not known.
Result<std::vector<Vec2>> points_2d(const PointTable& table, std::string_view u, std::string_view v);

/// The points of three columns; fails as points_2d.
Result<std::vector<Vec3>> points_3d(const PointTable& table, std::string_view x, std::string_view y,
                                    std::string_view z);

/// The points of two columns, nullopt where one of their values is not known; fails for a missing column.
Result<std::vector<std::optional<Vec2>>> seen_points_2d(const PointTable& table, std::string_view u,
                                                        std::string_view v);

}  // namespace plumbline
