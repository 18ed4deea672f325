// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "plumbline/rig/dataset.hpp"

namespace plumbline::detail {

/// Corners that contradict their neighbours on the board, found without any lens: each is predicted from the
/// 16 nearest corners by a polynomial of second degree in the plane of the board, fitted by least absolute
/// errors (only the pixels can be wrong, so that up to about a third of the neighbours may be), and is a
/// suspect when it is off by more than a tenth of the distance to its neighbours and six robust standard
/// deviations of the view. Distortion and perspective bend the image far less over so short a way. What is
/// off by that distance from a surface of second degree over the whole board, fitted likewise, is not asked:
/// a row that is wrong as a whole agrees with itself. Suspects are kept out of the start and judged by their
/// residuals later. \returns one flag for each corner of the view; none for a target that is not flat, for
/// fewer than 12 corners, and where more than 40 % would be suspects
std::vector<bool> suspect_corners(const Target& target, const View& view);

/// The data set without the suspects of each view.
Dataset without_suspects(const Dataset& data, int n_threads);

}  // namespace plumbline::detail
