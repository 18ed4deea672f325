// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <fmt/format.h>

#include <cmath>
#include <span>

#include "plumbline/core/result.hpp"
#include "refine/sampson.hpp"

/// The fit that the refinements of a fundamental matrix and of a relative pose share. Private to the module.
namespace plumbline::detail {

/// The least sum of squared Sampson distances.
template <int N, class State>
struct SampsonFit {
  State state;
  Eigen::Matrix<double, N, N> covariance;  ///< of a step of the state
  double rms_px = 0;                       ///< root mean square Sampson distance
  int iterations = 0;
};

/// What a failure says of the one that is refined.
struct SampsonWords {
  const char* where;
  const char* undetermined;  ///< "the fundamental matrix undetermined: ...; what to do"
  const char* start_from;    ///< the function that gives a start
};

/// Minimises over the N coordinates of a state with  matrix(), the M of b' M a = 0,  derivative(), d vec(M) /
/// d step column-major (9 x N), and plus(step). \returns kDegenerate when the pairs leave a coordinate
/// undetermined; kNotConverged
template <int N, class State>
Result<SampsonFit<N, State>> fit_sampson(const State& start, std::span<const MovingVector> a,
                                         std::span<const MovingVector> b, double sigma_px,
                                         const SampsonWords& words) {
  using Step = Eigen::Matrix<double, N, 1>;
  const auto evaluate = [&](const State& state, NormalEquations<N>& out) {
    const Mat3 M = state.matrix();
    const Eigen::Matrix<double, 9, N> J = state.derivative();
    for (std::size_t i = 0; i < a.size(); ++i) {
      const SampsonTerm term = sampson_term(M, a[i], b[i]);
      out.template add<1>(Eigen::Matrix<double, 1, 1>(term.value / sigma_px),
                          Eigen::Matrix<double, 1, N>(term.d_M.reshaped().transpose() * J / sigma_px));
    }
    return true;
  };
  const auto solution =
      solve_small<N>(start, evaluate, [](const State& s, const Step& d) { return s.plus(d); });
  const auto covariance = solution ? spd_inverse<N>(solution->equations.A) : std::nullopt;
  if (solution && !covariance) {
    return Error{ErrorCode::kDegenerate, fmt::format("the {} pairs leave {}", a.size(), words.undetermined),
                 words.where};
  }
  if (!solution || !is_settled(*solution, *covariance)) {
    return Error{
        ErrorCode::kNotConverged,
        fmt::format(
            "no minimum of the Sampson distances of {} pairs was reached; remove outliers, or start from {}",
            a.size(), words.start_from),
        words.where};
  }
  const NormalEquations<N>& at = solution->equations;
  return SampsonFit<N, State>{solution->state, *covariance,
                              sigma_px * std::sqrt(2 * at.cost / at.n_residuals), solution->iterations};
}

}  // namespace plumbline::detail
