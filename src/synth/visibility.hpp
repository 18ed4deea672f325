// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "plumbline/rig/rig.hpp"
#include "plumbline/synth/board.hpp"

namespace plumbline::detail {

/// Number of points of each drawing, in the order of the target's points. Empty when there are no drawings.
std::vector<int> points_per_drawing(const Target& target);

/// Whether this target is found whole or not at all by a detector: chessboards and circle grids carry no ids.
bool needs_whole(const TargetSpec& spec);

}  // namespace plumbline::detail
