// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "plumbline/core/linalg.hpp"
#include "plumbline/core/result.hpp"
#include "refine/small_solve.hpp"

/// What a refinement must have reached before it is an answer. Private to the module.
namespace plumbline::detail {

/// An eigenvalue of normal equations of unit diagonal below this fraction of the largest is rounding: the
/// step along it is not determined.
inline constexpr double kUndetermined = 1e-13;

/// Smallest over largest eigenvalue of A scaled to a unit diagonal; 0 when an entry of the diagonal is not
/// positive.
template <int N>
double determinacy(const Eigen::Matrix<double, N, N>& A) {
  if (!(A.diagonal().minCoeff() > 0) || !A.allFinite()) return 0;
  const Eigen::Matrix<double, N, 1> s = A.diagonal().cwiseSqrt().cwiseInverse();
  const VecX values = sym_eigen(s.asDiagonal() * A * s.asDiagonal()).values;
  return std::max(values[0], 0.0) / values[N - 1];
}

/// The inverse of the normal equations at a solution, or why there is no answer; `what` is what was sought.
template <int N, class State>
Result<Eigen::Matrix<double, N, N>> checked_covariance(const std::optional<SmallSolution<N, State>>& solution,
                                                       const char* what, const char* where) {
  if (!solution) {
    return Error{ErrorCode::kInvalidData,
                 fmt::format("the start is not finite, or puts a point where the {} has no image", what),
                 where};
  }
  const double determined = determinacy<N>(solution->equations.A);
  const auto inverse = spd_inverse<N>(solution->equations.A);
  if (!(determined > kUndetermined) || !inverse) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("the points do not determine the {} (eigenvalue ratio of the normal equations {:.2g}, at "
                    "least {:.0e} is needed); add points elsewhere",
                    what, determined, kUndetermined),
        where};
  }
  if (!solution->converged) {
    return Error{
        ErrorCode::kNotConverged,
        fmt::format(
            "the {} did not settle in {} iterations; check the points for wrong ones, or start nearer", what,
            solution->iterations),
        where};
  }
  return *inverse;
}

}  // namespace plumbline::detail
