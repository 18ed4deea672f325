// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <gtest/gtest.h>

#include "refine/block_solve.hpp"
#include "refine/refine_support.hpp"

/// What the tests of the block solver share: starts, and the same problem given to Ceres.
namespace plumbline::test {

/// Pushes all poses off by a normal step of `sigma` (radians and metres); all corners take part then.
inline void push_poses(Calibration& cal, double sigma, std::uint64_t seed) {
  Rng rng(seed);
  const auto push = [&](SE3& T) {
    Vec6 d;
    for (double& x : d) x = rng.normal(sigma);
    T = box_plus(T, d);
  };
  for (std::size_t i = 1; i < cal.rig.T_cam_rig.size(); ++i) push(cal.rig.T_cam_rig[i]);
  for (auto& T : cal.T_rig_board) push(*T);
  for (std::size_t i = 1; i < cal.T_board0_board.size(); ++i) push(cal.T_board0_board[i]);
  for (const View& view : cal.data.views) cal.fits.emplace_back(view.corners.size());
  cal.view_reason.assign(cal.data.views.size(), "");
}

/// The truth with noise on the corners, pushed off by some per cent and degrees.
inline Calibration start_of(const Simulation& sim, double noise_px, std::uint64_t seed) {
  Calibration cal = sim.truth;
  cal.data = with_noise(cal.data, noise_px, seed);
  for (Camera& camera : cal.rig.cameras) {
    const auto k = params(camera.lens);
    k[0] *= 1.03, k[1] *= 1.03, k[2] += 3, k[3] -= 4;
    for (std::size_t i = 4; i < k.size(); ++i) k[i] *= 0.5;
  }
  push_poses(cal, 0.01, seed);
  return cal;
}

inline Calibration start_of(const Scene& scene, double noise_px, std::uint64_t seed) {
  return start_of(simulate(scene), noise_px, seed);
}

inline void expect_same_optimum(const Calibration& start, detail::SolveSpec spec) {
  Calibration blocks = start, ceres = start;
  const detail::SolveReport a = detail::solve_blocks(blocks, spec), b = detail::solve_ceres(ceres, spec);
  ASSERT_TRUE(a.usable && a.converged) << a.termination;
  ASSERT_TRUE(b.usable) << b.termination;
  EXPECT_NEAR(a.cost, b.cost, 1e-9 * b.cost) << a.termination << " / " << b.termination;
}

}  // namespace plumbline::test
