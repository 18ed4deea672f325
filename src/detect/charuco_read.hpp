// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "detect/charuco_lattice.hpp"
#include "detect/markers.hpp"
#include "plumbline/target/target.hpp"

/// Markers read through a lattice, and the place of the lattice on the board that they tell.
namespace plumbline::detail {

/// A marker that a square may hold: its id and its turns (MarkerCodes), and how well the grey levels of the
/// square go with it (correlation, -1 to 1).
struct MarkerGuess {
  int id = -1, turn = 0;
  double score = 0;
};

/// What a square of a lattice holds. It looks like a marker: a border of one colour in a ring of the other.
struct ReadSquare {
  int c = 0, r = 0;  ///< place of its first corner in the lattice's grid
  bool is_negative = false;
  bool is_clear = false;  ///< the first guess is the dictionary's own code, or far better than the others
  std::vector<MarkerGuess> guesses;  ///< best first
};

/// A dictionary, and the marker of each code.
struct MarkerBook {
  MarkerCodes codes;
  std::unordered_map<std::uint64_t, MarkerGuess> marker;
};
MarkerBook marker_book(std::string_view dictionary);

/// The squares of a lattice that look like markers. Codes without an error are looked for in the whole
/// dictionary, blurred ones among the board's.
std::vector<ReadSquare> read_squares(const cv::Mat& grey, const SeenLattice& lattice, const Charuco& board,
                                     const MarkerBook& book);

/// Place of a lattice on a board: its node (c, r), turned by `turn` quarter turns (c, r) -> (-r, c) and
/// shifted, is the board's inner corner.
struct BoardPlacement {
  bool is_legacy = false, is_negative = false;
  int turn = 0;
  int shift_c = 0, shift_r = 0;
  int agreeing = 0;   ///< squares that hold the marker that this place asks for
  int opposed = 0;    ///< squares that clearly hold another
  int beyond = 0;     ///< of these, those around the board
  double weight = 0;  ///< of those that agree: a clear one counts 1
  bool is_sure = false;

  /// The board's inner corner at a node.
  std::pair<int, int> corner_of(int c, int r) const;
};

/// The placement under a layout with which most squares agree.
BoardPlacement place_on_board(const std::vector<ReadSquare>& squares, const Charuco& board, bool is_legacy);

}  // namespace plumbline::detail
