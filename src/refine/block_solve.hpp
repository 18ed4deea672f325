// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "refine/solve.hpp"

namespace plumbline::detail {

/// The optimum of solve_ceres() by a Levenberg-Marquardt method written for this shape of problem: each board
/// pose has a 6 x 6 block of its own and is eliminated (Schur complement), the shared parameters are solved
/// densely, and no Jacobian is stored. Bows and radial guards are part of it. O(views) time; the same bytes
/// for any number of threads. \pre block_solver_can(calibration, spec)
SolveReport solve_blocks(Calibration& calibration, const SolveSpec& spec);

/// False when some but not all components of a camera's rotation vector are held: such a rotation is stepped
/// in other coordinates, which only solve_ceres() knows; for clocks; and for more than 3000 shared
/// parameters, as several cameras with fine splines have.
bool block_solver_can(const Calibration& calibration, const SolveSpec& spec);

}  // namespace plumbline::detail
