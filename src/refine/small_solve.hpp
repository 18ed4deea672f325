// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "plumbline/core/types.hpp"

/// Levenberg-Marquardt for a handful of parameters and many residuals (one pose, one point, one P, F or H):
/// derivatives are summed straight into N x N normal equations, nothing is allocated, and the state moves on
/// its own manifold. Ceres solves the same problems in the tests; here its set-up alone would cost more than
/// the whole solve. Private to the module.
namespace plumbline::detail {

/// A = J'J, g = J'r and cost = r'r / 2 of residuals r with derivatives J along the N coordinates of a step.
template <int N>
struct NormalEquations {
  Eigen::Matrix<double, N, N> A = Eigen::Matrix<double, N, N>::Zero();
  Eigen::Matrix<double, N, 1> g = Eigen::Matrix<double, N, 1>::Zero();
  double cost = 0;
  int n_residuals = 0;

  /// Adds R residuals and their R x N derivatives.
  template <int R>
  void add(const Eigen::Matrix<double, R, 1>& r, const Eigen::Matrix<double, R, N>& J) {
    A.noalias() += J.transpose() * J;
    g.noalias() += J.transpose() * r;
    cost += 0.5 * r.squaredNorm();
    n_residuals += R;
  }
};

/// x with A x = b by Cholesky's factor without pivots; nullopt when A is not positive definite.
template <int N>
std::optional<Eigen::Matrix<double, N, 1>> cholesky_solve(Eigen::Matrix<double, N, N> A,
                                                          Eigen::Matrix<double, N, 1> b) {
  for (int j = 0; j < N; ++j) {  // A becomes its lower factor, b is carried along
    for (int k = 0; k < j; ++k) A.col(j).tail(N - j) -= A(j, k) * A.col(k).tail(N - j);
    if (!(A(j, j) > 0) || !std::isfinite(A(j, j))) return std::nullopt;
    A.col(j).tail(N - j) /= std::sqrt(A(j, j));
    b[j] /= A(j, j);
    b.tail(N - j - 1) -= b[j] * A.col(j).tail(N - j - 1);
  }
  for (int j = N - 1; j >= 0; --j) {
    b[j] = (b[j] - A.col(j).tail(N - j - 1).dot(b.tail(N - j - 1))) / A(j, j);
  }
  return b;
}

/// The inverse of a positive definite A, or nullopt: the covariance when A = J'J of residuals of unit
/// variance.
template <int N>
std::optional<Eigen::Matrix<double, N, N>> spd_inverse(const Eigen::Matrix<double, N, N>& A) {
  // Scaled to a unit diagonal, so that unlike units do not look like a singular matrix.
  Eigen::Matrix<double, N, 1> s;
  for (int i = 0; i < N; ++i) {
    if (!(A(i, i) > 0)) return std::nullopt;
    s[i] = 1 / std::sqrt(A(i, i));
  }
  const Eigen::Matrix<double, N, N> scaled = s.asDiagonal() * A * s.asDiagonal();
  Eigen::Matrix<double, N, N> inverse;
  for (int i = 0; i < N; ++i) {
    const auto column = cholesky_solve<N>(scaled, Eigen::Matrix<double, N, 1>::Unit(i));
    if (!column) return std::nullopt;
    inverse.col(i) = *column;
  }
  const Eigen::Matrix<double, N, N> result = s.asDiagonal() * inverse * s.asDiagonal();
  return Eigen::Matrix<double, N, N>(0.5 * (result + result.transpose()));
}

template <int N, class State>
struct SmallSolution {
  State state;
  NormalEquations<N> equations;  ///< at `state`
  int iterations = 0;            ///< steps tried
  bool converged = false;        ///< no step is expected to lower the cost by more than 1e-14 of it
};

/// Minimises the cost from `start`.
/// - evaluate(state, NormalEquations<N>&) fills zeroed equations and returns false where the state is outside
/// the
///   residuals' domain (such a step is rejected);
/// - plus(state, step) moves a state; derivatives are those of r(plus(state, step)) at step = 0.
/// nullopt when `start` is outside the domain or its cost is not finite. Residuals are in pixels or in
/// sigmas: a predicted gain below 1e-24 of their square counts as none.
template <int N, class State, class Evaluate, class Plus>
std::optional<SmallSolution<N, State>> solve_small(const State& start, Evaluate&& evaluate, Plus&& plus,
                                                   int max_iterations = 100) {
  using Vector = Eigen::Matrix<double, N, 1>;
  constexpr double kRelativeGain = 1e-14, kAbsoluteGain = 1e-24, kMaxDamping = 1e16;
  SmallSolution<N, State> best{start, {}, 0, false};
  if (!evaluate(best.state, best.equations) || !std::isfinite(best.equations.cost)) return std::nullopt;
  double damping = 1e-4, growth = 2;
  while (best.iterations < max_iterations && damping < kMaxDamping) {
    ++best.iterations;
    const NormalEquations<N>& e = best.equations;
    const double floor = 1e-12 * std::max(e.A.diagonal().maxCoeff(), 1e-300);
    const Vector scale = e.A.diagonal().cwiseMax(floor);
    Eigen::Matrix<double, N, N> damped = e.A;
    damped.diagonal() += damping * scale;
    const auto step = cholesky_solve<N>(damped, Vector(-e.g));
    double gain = 0, predicted = 0;
    if (step) {
      // Of the model without damping: -g'd - d'Ad/2, written so that it cannot cancel below zero.
      predicted = 0.5 * step->dot(damping * scale.cwiseProduct(*step) - e.g);
      if (!(predicted > kRelativeGain * e.cost + kAbsoluteGain)) {
        best.converged = damping <= 1 || e.g.cwiseAbs2().cwiseQuotient(scale).maxCoeff() <=
                                             kRelativeGain * e.cost + kAbsoluteGain;
        if (best.converged) break;
      }
      SmallSolution<N, State> next{plus(best.state, *step), {}, best.iterations, false};
      if (evaluate(next.state, next.equations) && std::isfinite(next.equations.cost)) {
        gain = e.cost - next.equations.cost;
        if (gain > 0) best = std::move(next);
      }
    }
    if (gain > 0) {  // Nielsen 1999
      const double ratio = 2 * gain / predicted - 1;
      damping *= std::max(1.0 / 3, 1 - ratio * ratio * ratio);
      growth = 2;
    } else if (step && predicted <= 1e-11 * best.equations.cost) {
      best.converged = true;  // rounding of the cost hides what is left to gain
      break;
    } else {
      damping *= growth;
      growth *= 2;
    }
  }
  return best;
}

}  // namespace plumbline::detail
