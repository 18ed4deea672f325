// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "plumbline/lens/lens.hpp"

namespace plumbline {

/// What of a lens lies outside the range that its paper and other software keep to, although its formula
/// makes sense there: "alpha = 1.04: ucm is used with 0 <= alpha < 1". Empty when nothing does. Files of
/// Kalibr cannot hold such a lens. ucm: 0 <= alpha < 1 (xi of Mei from 0 on); eucm: 0 <= alpha <= 1 and beta
/// > 0 (Khomutenko, Garcia & Martinet 2016); ds: 0 <= alpha <= 1 (Usenko, Demmel & Cremers 2018).
std::string out_of_range(const Lens& lens);

}  // namespace plumbline
