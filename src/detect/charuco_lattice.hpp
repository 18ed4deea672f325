// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "detect/chess_grid.hpp"

/// Lattices of saddles that may be the inner corners of a board with markers in its squares.
namespace plumbline::detail {

/// A lattice, in pixels of the image.
struct SeenLattice {
  ChessGrid grid;             ///< the saddles, and around and between them the places that they foretell
  std::vector<char> is_seen;  ///< by place of the grid
  int n_seen = 0;
  double scale = 1;  ///< of the image that it was found in: places are good to a pixel of that
};

/// The lattices of an image, at its size and halves of it; each size is searched when it is asked for and not
/// twice. Knows of no board, so that several boards share it.
class LatticePyramid {
 public:
  explicit LatticePyramid(const cv::Mat& grey);
  int n_levels() const { return static_cast<int>(images_.size()); }
  /// The coarsest level is 0. Largest lattices first.
  const std::vector<SeenLattice>& level(int k);
  const cv::Mat& grey() const { return images_.back(); }

 private:
  std::vector<cv::Mat> images_;
  std::vector<std::optional<std::vector<SeenLattice>>> levels_;
};

}  // namespace plumbline::detail
