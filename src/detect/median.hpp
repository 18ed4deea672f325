// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

namespace plumbline::detail {

/// The value in the middle, of an even number the upper one; 0 of none.
double median(std::vector<double> values);

}  // namespace plumbline::detail
