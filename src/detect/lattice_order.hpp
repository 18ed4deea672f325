// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <optional>
#include <vector>

#include "plumbline/core/types.hpp"

namespace plumbline::detail {

/// Points of a columns x rows lattice, row by row.
struct LatticePoints {
  int columns = 0, rows = 0;
  std::vector<Vec2> px;
  const Vec2& at(int c, int r) const { return px[static_cast<std::size_t>(r * columns + c)]; }
};

/// The same points numbered so that x goes right and y goes down on the board (not mirrored) and, of the
/// numberings that `allows` accepts, the one whose first point lies nearest to the top left of the image.
/// nullopt when none is.
std::optional<LatticePoints> orient(const LatticePoints& points,
                                    const std::function<bool(const LatticePoints&)>& allows);

}  // namespace plumbline::detail
