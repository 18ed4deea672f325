// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "plumbline/refine/refine.hpp"
#include "refine/solve.hpp"

namespace plumbline::detail {

/// What keep_monotonic() did with one camera.
struct MonotonicNote {
  int cam = 0;
  bool held = false;  ///< else the validity was set
  VecX moved;         ///< lens parameters of the constrained fit less those of the free one
  std::string consequence;
};

/// Looks whether the radial map of each lens rises over the whole image. Where it turns back inside the
/// picture, or runs off to infinity (folds_in_image()), the corners are fitted once more with the constraint
/// that it rises. That fit is taken when it arrived at its optimum within the iterations and the corners do
/// not contradict it (twice the difference of the costs, over the variance of a residual, is at most 16: four
/// sigma). Otherwise the free fit stays, and the camera's validity ends 5 % (of the angle) beyond the
/// outermost corner used, or at the turn (fold_of()) if that is nearer. \param report  of the solve, brought
/// up to date
std::vector<MonotonicNote> keep_monotonic(Calibration& calibration, const SolveSpec& spec,
                                          SolveReport& report);

/// Puts the notes in front of stats.weak, with sigmas from the covariance, and "held monotonic" into the
/// options of the provenance.
void add_notes(Calibration& calibration, const std::vector<MonotonicNote>& notes);

}  // namespace plumbline::detail
