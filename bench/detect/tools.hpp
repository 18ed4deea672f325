// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "plumbline/rig/dataset.hpp"
#include "plumbline/target/target.hpp"

namespace plumbline::bench {

/// Corners with their ids as the tool gives them, in the tool's own pixel convention; empty: not found.
/// sigma_px 0: the tool says none.
struct Answer {
  std::vector<Corner> corners;
  double child_ms = 0;  ///< CPU time of a program that was run, which is not in this process' time
};

struct Tool {
  std::string name;
  std::function<Answer(const cv::Mat&)> run;
};

/// Plumbline first, then those of its peers that look for such a board. Chessboard finders number from either
/// end.
std::vector<Tool> tools_for(const Target& target, bool with_peers);

/// Whether the program mrgingham is installed.
bool has_mrgingham();

}  // namespace plumbline::bench
