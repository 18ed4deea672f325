// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <cstddef>

namespace plumbline::detail {

/// Frames are summed in so many runs, each by one thread, and the runs in order: the sums do not depend on
/// the number of threads.
struct Runs {
  static constexpr int kMost = 32;
  int n_frames, n_runs;
  explicit Runs(std::size_t n) : n_frames(static_cast<int>(n)), n_runs(std::min(n_frames, kMost)) {}
  int first(int run) const { return static_cast<int>(static_cast<long>(n_frames) * run / n_runs); }
};

}  // namespace plumbline::detail
