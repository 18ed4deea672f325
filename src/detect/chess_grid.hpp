// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "detect/saddles.hpp"
#include "plumbline/target/target.hpp"

namespace plumbline::detail {

/// The inner corners of a chessboard, row by row, as far as they are known.
struct ChessGrid {
  int columns = 0, rows = 0;
  std::vector<std::optional<Vec2>> px;

  ChessGrid() = default;
  ChessGrid(int n_columns, int n_rows)
      : columns(n_columns), rows(n_rows), px(static_cast<std::size_t>(n_columns) * n_rows) {}
  const std::optional<Vec2>& at(int c, int r) const { return px[static_cast<std::size_t>(r) * columns + c]; }
  std::optional<Vec2>& at(int c, int r) { return px[static_cast<std::size_t>(r) * columns + c]; }
  /// As at(), and nothing outside of the board.
  std::optional<Vec2> get(int c, int r) const {
    return c < 0 || r < 0 || c >= columns || r >= rows ? std::nullopt : at(c, r);
  }
  int count() const;
};

/// Where the corner (c, r) should be by those in its row, its column or beside it; nullopt where no two of
/// them lie so that they say it.
std::optional<Vec2> foretold(const ChessGrid& grid, int c, int r);

/// d px / d (c, r) at a corner by its neighbours, or along an axis without one by those of the line beside
/// it; nullopt where there are neither.
std::optional<Mat2> steps_at(const ChessGrid& grid, int c, int r);

/// Bend of the row and of the column through a corner [1/px], as SaddleWindow::curvature wants them; 0 where
/// too few neighbours are known.
Vec2 curvature_at(const ChessGrid& grid, int c, int r);

/// The places of a lattice's nodes on a board: the one numbering, or what is in the way. A board is
/// recognised by its colours and by its ends: a corner of the board that is not in the lattice has to be
/// outside of the image or at its border, but for a few holes. Where several numberings are possible a whole
/// board begins at the corner nearest to the image's top left, and a part of one has none.
std::variant<ChessGrid, std::string> place_lattice(const std::vector<LatticeNode>& nodes,
                                                   const std::vector<Saddle>& saddles,
                                                   const Chessboard& board, cv::Size image);

}  // namespace plumbline::detail
