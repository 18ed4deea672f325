// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <utility>
#include <vector>

#include "plumbline/refine/refine.hpp"
#include "refine/solve.hpp"

/// What the options say of single parameters, by index into shared_parameter_names().
namespace plumbline::detail {

struct Constraints {
  std::vector<bool> held;
  std::vector<int> tied_to;                    ///< the first of those that share one value; itself when alone
  std::vector<std::pair<int, double>> values;  ///< held at these instead of at the start
  std::vector<PriorTerm> priors;

  bool any() const;
};

/// The names and groups of the options (refine.hpp) as indices. kInvalidData: a name that does not exist
/// (lists those that do), a value that is no number or no focal length, two values for one parameter, a tie
/// that does not pair up or that ties rotations, a prior whose sigma is not positive.
Result<Constraints> constraints_of(const Calibration& calibration, const RefineOptions& options);

/// Those of one camera's lens alone: `n` parameters from `first` on. Ties to other cameras are dropped.
Constraints slice(const Constraints& constraints, int first, int n);

/// Brings a start to where the constraints want it: given values, and tied parameters equal: the value of the
/// held one, or else their mean. Parameters that are free keep every bit.
void apply(Calibration& calibration, const Constraints& constraints);
/// The same for one lens, whose parameters come first in `constraints`.
void apply(Lens& lens, const Constraints& constraints);

/// The part of a solve's description that the constraints fill.
SolveSpec with_constraints(SolveSpec spec, const Constraints& constraints);

/// How far each prior and its estimate are apart.
std::vector<PriorPull> prior_pulls(const Calibration& calibration, const std::vector<PriorTerm>& priors);

}  // namespace plumbline::detail
