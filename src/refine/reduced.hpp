// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>

#include "refine/solve.hpp"

namespace plumbline::detail {

/// What one frame says of the shared parameters once its board pose follows them: with a step d of theirs,
/// its (robustified) residuals at the best pose are r + J d, to first order.
struct PoseFreeFrame {
  int frame = 0;  ///< index into Calibration::T_rig_board
  MatX J;
  VecX r;
  double sum_sq = 0;  ///< of the residuals at the pose it has
};
void for_each_pose_free_frame(const Calibration& calibration, const SolveSpec& spec,
                              const std::function<void(const PoseFreeFrame&)>& take);

}  // namespace plumbline::detail
