// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "plumbline/refine/refine.hpp"
#include "refine/reprojection_cost.hpp"

/// The state of every solve is a Calibration: a view takes part when `fits[v]` is not empty and its frame has
/// a pose; a corner of such a view takes part unless it is marked as an outlier.
namespace plumbline::detail {

inline constexpr int kGuardDirections = 8;

/// Where the radial map of a camera's lens shall rise. Distances from the axis are tan(angle) for a lens that
/// looks forward only and the angle itself [rad] for the others.
struct RadialGuard {
  int cam = 0;
  double from = 0;
  std::array<double, kGuardDirections> to{};  ///< in the directions i * 45 degrees from +x to +y
  double least_slope_px = 0;                  ///< per unit of distance from the axis
};

/// ((parameter - value) / sigma)^2 in the cost.
struct PriorTerm {
  int index = 0;  ///< into shared_parameter_names()
  double value = 0, sigma = 1;
};

struct SolveSpec {
  Loss loss = Loss::kSquared;
  double loss_scale = 1.0;
  bool use_sigma = false;
  int max_iterations = 200;
  bool tight = true;            ///< false: stop at 1e-7 relative change, for seeds
  std::vector<bool> held = {};  ///< over shared_parameter_names(); empty: none
  /// Over the same: the first of the parameters that share one value, which start equal; itself when alone.
  /// Tied parameters are held all or none, and none is a rotation's. Empty: no ties.
  std::vector<int> tied_to = {};
  std::vector<PriorTerm> priors = {};
  /// What a residual of 1 in a prior weighs: the standard deviation of one (weighted) residual coordinate, so
  /// that corners and priors weigh by what they are worth.
  double prior_weight = 1.0;
  /// The share of the residuals' variance that marking outliers leaves of it (truncated_variance()).
  double variance_kept = 1.0;
  bool hold_boards = false;  ///< move no board pose
  /// One-sided constraints on radial maps; solve_moving() does not know them. That of a camera that no view
  /// shows is left out.
  std::vector<RadialGuard> guards = {};
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

/// The reference: Ceres on one thread, one cost for each view. For a lens with sparse derivatives one for
/// each corner, and the lens' own regularisation (make_prior_cost()), which is then part of the cost.
/// A calibration with clocks: solve_moving().
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

/// The free numbers behind the shared parameters: column[i] is that of parameter i, -1 where it is held.
struct Reduction {
  std::vector<int> column;
  int n_free = 0;
};
Reduction reduction_of(const SolveSpec& spec, int n_shared);

/// The shared parameters as numbers: lenses, then rotation vector [rad] and translation [m] of each pose.
VecX shared_values(const Calibration& calibration);
void set_shared_value(Calibration& calibration, int index, double value);

/// The priors as residuals r = prior_weight * (value of the parameter - value of the prior) / sigma, and
/// their derivatives J by the STEP of each shared parameter (box_plus for poses): one row each. Their share
/// of the cost is r'r / 2.
struct PriorRows {
  VecX r;
  MatX J;
};
PriorRows prior_rows(const Calibration& calibration, const SolveSpec& spec);

/// What the priors say of the scatter: how many there are of something that is free, and the sum of their
/// squared residuals. A prior of what is held is a constant, and no measurement of anything estimated.
struct PriorScatter {
  int n = 0;
  double sum = 0;
};
PriorScatter scatter_of(const PriorRows& priors, const Reduction& reduction);

/// Residuals of all corners of all views that take part. A corner that the lens does not project is marked as
/// an outlier, with a zero residual; their number is returned.
int evaluate(Calibration& calibration);

/// Covariance of the shared parameters for a variance of 1 of each (robustified) residual coordinate: the
/// inverse of the reduced normal matrix S = H_ss - sum_f H_sf H_ff^-1 H_fs, where f runs over the board
/// poses, and the priors' rows are part of J. Rows and columns of held parameters are zero, those of tied
/// ones equal. Directions that the data do not determine at all (an eigenvalue below 1e-14 of the largest, of
/// S scaled to a unit diagonal) get that bound as their eigenvalue, so that their variance is huge but
/// finite.
struct SharedCovariance {
  MatX unit_covariance;
  VecX
      null_direction;  ///< the least determined of those directions, unit length, scaled parameters; or empty
  /// Of one residual coordinate: (sum r'^2 / variance_kept + sum p^2) / (residuals + priors - free
  /// parameters), p the priors' residuals (prior_rows()). Priors of held parameters count in neither.
  double variance = 0;
  int n_residuals = 0, n_free = 0;
};
SharedCovariance shared_covariance(const Calibration& calibration, const SolveSpec& spec);

/// The variance of one residual coordinate, as above. In a rig with a splined lens, whose control points the
/// corners do not determine one by one, without a covariance: those then do not count as unknowns, which
/// makes it too small by their share of the residuals, and the lens' regularisation is no residual.
double residual_variance(const Calibration& calibration, const SolveSpec& spec);

/// Holds fx fy cx cy of the lenses whose other parameters can express them.
void hold_cores(const Rig& rig, std::vector<bool>& held);

}  // namespace plumbline::detail
