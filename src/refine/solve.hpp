// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "plumbline/refine/refine.hpp"
#include "refine/reprojection_cost.hpp"

/// The state of every solve is a Calibration: a view takes part when `fits[v]` is not empty and its frame has
/// a pose; a corner of such a view takes part unless it is marked as an outlier.
namespace plumbline::detail {

struct SolveSpec {
  Loss loss = Loss::kSquared;
  double loss_scale = 1.0;
  bool use_sigma = false;
  int max_iterations = 200;
  bool tight = true;            ///< false: stop at 1e-7 relative change, for seeds
  std::vector<bool> held = {};  ///< over shared_parameter_names(); empty: none
  bool hold_boards = false;     ///< move no board pose
  Solver solver = Solver::kBlocks;
  int n_threads = 1;  ///< of the block solver
};

struct SolveReport {
  bool usable = false;  ///< an optimum with finite numbers
  bool converged = false;
  double cost = 0;  ///< half the sum of rho
  int iterations = 0;
  std::string termination;
};

/// Minimises the reprojection error in place. Not usable when a corner that takes part does not project at
/// the start. The block solver where it can (block_solve.hpp), Ceres otherwise or when the spec asks for it.
SolveReport solve(Calibration& calibration, const SolveSpec& spec);

/// The reference: Ceres on one thread, one cost for each view; of a calibration with clocks solve_moving().
SolveReport solve_ceres(Calibration& calibration, const SolveSpec& spec);

bool takes_part(const Calibration& calibration, std::size_t view);

/// The corners of a view that take part; none when the view does not.
std::vector<Observation> observations_of(const Calibration& calibration, std::size_t view, bool use_sigma);

/// Where the shared parameters of each camera and each board start in shared_parameter_names(); pose[0] = -1
/// and board[0] = -1: camera 0 and the first board have none.
struct Offsets {
  std::vector<int> lens, pose, board;
  std::vector<int> bow = {};                           ///< per target; -1: it is flat
  std::vector<int> line_delay = {}, time_offset = {};  ///< per camera; -1: it has none
  int total = 0;
};
Offsets offsets_of(const Calibration& calibration);
/// The same for a calibration of one board.
Offsets offsets_of(const Rig& rig);

/// Residuals of all corners of all views that take part. A corner that the lens does not project is marked as
/// an outlier, with a zero residual; their number is returned.
int evaluate(Calibration& calibration);

/// Covariance of the shared parameters for a variance of 1 of each (robustified) residual coordinate: the
/// inverse of the reduced normal matrix S = H_ss - sum_f H_sf H_ff^-1 H_fs, where f runs over the board
/// poses. Rows and columns of held parameters are zero. Directions
/// that the data do not determine at all (an eigenvalue below 1e-14 of the largest, of S scaled to a unit
/// diagonal) get that bound as their eigenvalue, so that their variance is huge but finite.
struct SharedCovariance {
  MatX unit_covariance;
  VecX
      null_direction;  ///< the least determined of those directions, unit length, scaled parameters; or empty
  double variance = 0;  ///< of one residual coordinate, sum r'^2 / (residuals - free parameters)
  int n_residuals = 0, n_free = 0;
};
SharedCovariance shared_covariance(const Calibration& calibration, const SolveSpec& spec);

/// Which shared parameters `fixed` names. kInvalidData lists the names there are.
Result<std::vector<bool>> held_mask(const Calibration& calibration, const std::vector<std::string>& fixed);

}  // namespace plumbline::detail
