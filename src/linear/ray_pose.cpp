// SPDX-License-Identifier: Apache-2.0
#include "linear/ray_pose.hpp"

#include <cmath>
#include <limits>
#include <optional>

#include "plumbline/core/linalg.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline::detail {
namespace {

// Sum of squared chords between the unit rays and the unit directions of T p: it grows all the way to 180
// degrees.
double cost(const RaySighting& s, const SE3& T_cam_board) {
  const Mat3 R = T_cam_board.R();
  const Vec3 t = T_cam_board.t();
  double sum = 0;
  for (std::size_t i = 0; i < s.p_board.size(); ++i) {
    sum += ((R * s.p_board[i] + t).normalized() - s.rays_cam[i]).squaredNorm();
  }
  return std::isfinite(sum) ? sum : std::numeric_limits<double>::infinity();
}

// The Gauss-Newton step of cost() in the coordinates of box_plus.
std::optional<Vec6> gauss_newton_step(const RaySighting& s, const SE3& T_cam_board) {
  const Mat3 R = T_cam_board.R();
  const Vec3 t = T_cam_board.t();
  Mat6 A = Mat6::Zero();
  Vec6 b = Vec6::Zero();
  for (std::size_t i = 0; i < s.p_board.size(); ++i) {
    const Vec3 Rp = R * s.p_board[i], q = Rp + t;
    const double distance = q.norm();
    if (!(distance > 0)) return std::nullopt;
    const Vec3 u = q / distance;
    const Mat3 J_u_q = (Mat3::Identity() - u * u.transpose()) / distance;
    Eigen::Matrix<double, 3, 6> J;
    J << -J_u_q * skew(Rp), J_u_q;
    A += J.transpose() * J;
    b += J.transpose() * (s.rays_cam[i] - u);
  }
  const auto step = solve_spd(A, b);
  if (!step) return std::nullopt;
  return Vec6(*step);
}

}  // namespace

PoseCandidate polish(const RaySighting& s, const SE3& start, int max_iterations, double least_gain) {
  PoseCandidate best{start, cost(s, start)};
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    const auto full = gauss_newton_step(s, best.T_cam_board);
    if (!full) break;
    Vec6 step = *full;
    bool better = false;
    const double before = best.cost;
    for (int halving = 0; halving < 8 && !better; ++halving, step *= 0.5) {
      const SE3 trial = box_plus(best.T_cam_board, step);
      const double trial_cost = cost(s, trial);
      if (!(trial_cost < best.cost)) continue;
      better = true;
      best = {trial, trial_cost};
    }
    if (!better || before - best.cost < least_gain * before ||
        full->norm() < 1e-14 * (1 + best.T_cam_board.t().norm()))
      break;
  }
  return best;
}

RaySighting unproject_all(const Lens& lens, std::span<const Vec3> p_board, std::span<const Vec2> px) {
  RaySighting s;
  for (std::size_t i = 0; i < px.size(); ++i) {
    if (!p_board[i].allFinite()) continue;
    if (const auto ray = unproject(lens, px[i])) {
      s.p_board.push_back(p_board[i]);
      s.rays_cam.push_back(*ray);
    }
  }
  return s;
}

SE3 plane_frame(const Spread& spread) {
  Mat3 axes = spread.axes;
  if (axes.determinant() < 0) axes.col(2) *= -1;
  return {axes.transpose(), -axes.transpose() * Vec3(spread.centroid)};
}

}  // namespace plumbline::detail
