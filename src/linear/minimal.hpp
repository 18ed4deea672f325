// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>

#include "plumbline/core/types.hpp"

/// The minimal solvers of two views on plain 3-vectors, without the heap. Private to the module.
namespace plumbline::detail {

/// A few answers of a minimal solver.
template <int Most>
struct Answers {
  std::array<Mat3, Most> matrix;
  int n = 0;
  double determinacy = 0;  ///< of the linear constraints: near 0 when the sample is degenerate
};

/// The F with b' F a = 0 for seven pairs and det F = 0, |F| = 1: one or three (H&Z 11.1.2).
Answers<3> seven_point(const std::array<Vec3, 7>& a, const std::array<Vec3, 7>& b);

/// The essential matrices of five pairs, |E| = sqrt(2) (Nister 2004), polished to rounding.
Answers<10> five_point(const std::array<Vec3, 5>& a, const std::array<Vec3, 5>& b);

}  // namespace plumbline::detail
