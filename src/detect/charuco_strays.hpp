// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "detect/chess_fit.hpp"

namespace plumbline::detail {

/// Without the corners that lie elsewhere than both of their lines say: each line foretells a corner by a
/// cubic through its neighbours, or by a parabola at an end. The worst goes first. Blurred markers close by
/// mislead fits so that their sigma does not say it.
std::vector<ChessCorner> without_odd(std::vector<ChessCorner> corners, int columns, int rows);

}  // namespace plumbline::detail
