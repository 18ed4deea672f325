// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "detect/chess_search.hpp"

namespace plumbline::detail {

/// Without the rough corners that lie elsewhere than both of their lines say: each line foretells a corner by
/// a cubic through its neighbours, or by a parabola at an end. Blurred markers close by mislead fits so that
/// their sigma does not say it. The worst goes first.
std::vector<ChessCorner> without_odd(std::vector<ChessCorner> corners, int columns, int rows);

}  // namespace plumbline::detail
