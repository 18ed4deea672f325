// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>

#include "plumbline/geometry/se3.hpp"

namespace plumbline::detail {

/// The pose in one of Ceres' parameter blocks of seven numbers.
inline SE3 pose_of(const double* block) {
  SE3 T;
  std::copy_n(block, 7, T.qt.begin());
  return T;
}

}  // namespace plumbline::detail
