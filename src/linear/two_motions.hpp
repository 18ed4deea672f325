// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>

#include "plumbline/core/types.hpp"

namespace plumbline::detail {

/// The essential matrices of the two motions that map the rays of a plane by H, b ~ H a with positive
/// factors, H = R + t n' of any positive scale (Ma, Soatto, Kosecka & Sastry 2004, table 5.1), |E| = sqrt(2).
/// They coincide when t is along n. Private to the module.
std::array<Mat3, 2> two_motions_of_plane(const Mat3& H);

}  // namespace plumbline::detail
