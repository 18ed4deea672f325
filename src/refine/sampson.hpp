// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cmath>

#include "plumbline/core/types.hpp"
#include "refine/small_solve.hpp"

/// The Sampson distance of a pair of 3-vectors and its derivative along the entries of a matrix. Private to
/// the module.
namespace plumbline::detail {

/// A vector that moves with its pixel: (x, y, 1), or the ray of a lens.
struct MovingVector {
  Vec3 v;
  Eigen::Matrix<double, 3, 2> J_v_px;
};

/// b' M a over the length of its derivative along both pixels [px], signed, and d/dM of it.
struct SampsonTerm {
  double value = 0;
  Mat3 d_M = Mat3::Zero();
};

inline SampsonTerm sampson_term(const Mat3& M, const MovingVector& a, const MovingVector& b) {
  const Vec3 Ma = M * a.v, Mb = M.transpose() * b.v;
  const double c = b.v.dot(Ma);
  const Vec2 slope_1 = a.J_v_px.transpose() * Mb, slope_2 = b.J_v_px.transpose() * Ma;
  const double slope2 = slope_1.squaredNorm() + slope_2.squaredNorm();
  SampsonTerm out;
  if (!(slope2 > 0)) return out;  // at both epipoles: on the curve, and no direction off it
  const double inverse = 1 / std::sqrt(slope2);
  out.value = c * inverse;
  const Vec3 along_1 = a.J_v_px * slope_1, along_2 = b.J_v_px * slope_2;
  out.d_M = inverse * (b.v * a.v.transpose()) -
            (out.value / slope2) * (b.v * along_1.transpose() + along_2 * a.v.transpose());
  return out;
}

/// Whether a solution is as good as at its minimum: converged, or so slow (the residual of a pair near an
/// epipole bends) that Gauss-Newton's next step would be below 1e-3 standard deviations.
template <int N, class State>
bool is_settled(const SmallSolution<N, State>& solution, const Eigen::Matrix<double, N, N>& covariance) {
  constexpr double kStep = 1e-3;
  const auto& g = solution.equations.g;
  return solution.converged || g.dot(covariance * g) < kStep * kStep;
}

}  // namespace plumbline::detail
