// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "plumbline/refine/refine.hpp"
#include "refine/solve.hpp"

namespace plumbline::detail {

/// Fills covariance and stats.weak of an optimum, and refuses it when the data do not determine the lenses.
Status judge_determination(Calibration& calibration, const SolveSpec& spec);

/// "left fx (+0.71), left fy (+0.70)", largest share first, without shares under a fifth; and the index of
/// the first. Element i of the direction is called names[first_name + i].
std::pair<std::string, int> describe_direction(const VecX& direction, const std::vector<std::string>& names,
                                               int first_name);

/// Adds to stats.weak what is wrong with the poses of cameras and boards to one another: uncertain ones with
/// the direction, those that hang on one frame, boards that no frame ties to the first.
void add_weak_rig(Calibration& calibration, const MatX& covariance, const std::vector<std::string>& names);

/// Holds the poses of boards that nothing ties to the first: of each group of boards that never share a frame
/// with it, the first board. Their pose to the first board says nothing, and no other parameter depends on
/// it. \returns `held` with these
std::vector<bool> hold_loose_boards(const Calibration& calibration, std::vector<bool> held);

}  // namespace plumbline::detail
