// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>

#include "plumbline/refine/refine.hpp"

/// What is estimated beyond lenses, rig and poses only when it is asked for, or when the data speak for it:
/// the bows of boards, line delays and time offsets.
namespace plumbline::detail {

/// Gives a start the parameters of the effects that are asked for (kYes), at zero. kInvalidData when no board
/// of the data can be bowed; kDegenerate as check_recording().
Status add_wanted_effects(Calibration& start, const RefineOptions& options);

/// From a start with these parameters to an optimum with marks, statistics and covariance.
using Finish = std::function<Result<Calibration>(Calibration)>;

/// Decides about the effects that are on kAuto. The larger model, with all of them, is solved from the lenses
/// and poses of `plain`, the optimum without; each effect is then judged by F = b' C^-1 b / d of its d
/// parameters b and their covariance C, to the second order the F statistic of the rise in cost without them.
/// It is kept when chance gives as large an F with a probability under kFalseAlarm / (number of effects
/// judged). When some are kept and others are not, the model of the kept ones is solved. stats.effects tells
/// of each. \param start  that `plain` was found from: views that were dropped on the way to it are back
Result<Calibration> choose_effects(const Calibration& start, Calibration plain, const RefineOptions& options,
                                   const Finish& finish);
inline constexpr double kFalseAlarm = 0.01;

/// The probability that F of 1 or 2 over `n` degrees of freedom is larger by chance. Exact for 2; for 1 by a
/// normal deviate (Wallace 1959), to 1 % from n = 20 on.
double chance_of_f(double f, int n_effect, int n);

}  // namespace plumbline::detail
