// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <vector>

#include "detect/charuco_read.hpp"
#include "detect/markers.hpp"
#include "plumbline/detect/detect.hpp"

namespace plumbline::detail {

/// What an image's lattices say of a board, under both layouts where it has two.
struct CharucoReading {
  struct Part {
    SeenLattice lattice;
    BoardPlacement current, legacy;
  };
  std::vector<Part>
      parts;  ///< those that lie on the board for sure under one layout at least; the largest first
  /// Detection::layout_vote; 0 unless has_open_layout.
  int layout_vote = 0;
  int n_markers = 0;  ///< squares with a marker of the board, on the lattice that has most of them
  int n_opposed = 0;  ///< there, those that lie elsewhere than on the board
};

/// A board, looked for from the coarsest level to the finest: the first that shows all corners that are in
/// sight, or the one that shows most. A layout that is open is the one with more votes.
struct CharucoFind {
  CharucoReading reading;
  Detection detection;
};
CharucoFind find_charuco(LatticePyramid& pyramid, const Charuco& board);

/// The board's corners from a reading, under one of its layouts.
Detection charuco_from_reading(const cv::Mat& grey, const Charuco& board, const CharucoReading& reading,
                               bool is_legacy);

/// Whether the board looks different under the two layouts and the target leaves open which it is.
inline bool has_open_layout(const Charuco& board) {
  return board.layout == Charuco::Layout::kAuto && board.rows % 2 == 0;
}

/// The target with its open layouts set to `layout`; nullopt when it has none.
std::optional<Target> with_layout(const Target& target, Charuco::Layout layout);

/// The tag corners of an AprilGrid from the tags in the image.
Detection aprilgrid_from_tags(const cv::Mat& grey, const AprilGrid& board, const std::vector<Marker>& tags);

/// Number of markers of a ChArUco board.
inline int n_markers(const Charuco& board) { return board.columns * board.rows / 2; }

}  // namespace plumbline::detail
