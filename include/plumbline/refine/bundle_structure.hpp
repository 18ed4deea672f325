// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "plumbline/refine/bundle.hpp"

/// Which sighting depends on which unknowns, as a picture: the reason why bundle adjustment is fast.
namespace plumbline {

/// The blocks of J, and with them those of J'J. Columns are the blocks that move, in the solver's order of
/// elimination turned round: lenses, views, points.
struct BundleStructure {
  enum class Kind { kLens, kView, kPoint };
  struct Column {
    Kind kind = Kind::kPoint;
    int index = 0;  ///< of the camera, view or point
    int size = 0;   ///< steps: 3 of a point, 6 of a view (5 on the default gauge's sphere)
  };
  std::vector<Column> columns;
  /// Row blocks, two residuals of a sighting each (then one for each scale bar): the columns it touches,
  /// ascending. Sorted by point, then by view.
  std::vector<std::vector<int>> rows;
  std::vector<int> row_size;
};

/// The structure of the solve that adjust_bundle() would do from here; its failures are those of
/// adjust_bundle() before it iterates.
Result<BundleStructure> bundle_structure(const Reconstruction& scene, const BundleOptions& options = {});

/// A picture of at most `most_px` pixels a side, a pixel for each scalar of the matrix or for each rectangle
/// of several scalars (then it shows whether any of them can be other than zero).
struct StructureImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> pixels;  ///< row by row: 0 where all is zero, else 1 + Kind of the column; in J'J
                                     ///< 4 where blocks of two kinds meet
  double columns_per_px = 1, rows_per_px = 1;  ///< scalars
};
StructureImage draw_jacobian(const BundleStructure& structure, int most_px = 800);
StructureImage draw_normal_matrix(const BundleStructure& structure, int most_px = 800);

/// Both pictures side by side as SVG, with their sizes in words.
std::string format_structure_svg(const BundleStructure& structure, int most_px = 800);

}  // namespace plumbline
