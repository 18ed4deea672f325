// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>

#include "plumbline/core/types.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"

namespace ceres {
class CostFunction;
class Manifold;
}  // namespace ceres

namespace plumbline::detail {

/// The cost of one sighting: 2 residuals (projection - px) / sigma over the blocks [lens parameters |
/// T_cam_world (7) | p_world (3)]. Poses are stepped as make_pose_manifold() steps them: the derivatives by
/// the step stand in the first six of the seven columns. Evaluate returns false outside the lens' domain, and
/// Ceres then rejects the step. A lens with sparse derivatives must outlive the cost, which reads it instead
/// of its block: that block is to be held constant, and asking for its derivatives fails.
std::unique_ptr<ceres::CostFunction> make_sighting_cost(const Lens& lens, const Vec2& px, double sigma_px);

/// One residual (|p_a - p_b| - length) / sigma over the blocks [p_a (3) | p_b (3)]; false where p_a = p_b,
/// which has no derivative.
std::unique_ptr<ceres::CostFunction> make_scale_bar_cost(double length, double sigma);

/// Steps a T_cam_world whose camera centre C stays at the distance |C - anchor| from a point: five degrees of
/// freedom, a rotation dw as in box_plus and two moves [unit of length] of the centre over the sphere about
/// the anchor.
class SphereStep {
 public:
  SphereStep(const Vec3& anchor, double radius) : anchor_(anchor), radius_(radius) {}
  SE3 plus(const SE3& T_cam_world, const Eigen::Matrix<double, 5, 1>& d) const;
  /// d[dw | dt] of box_plus by d, at d = 0.
  Eigen::Matrix<double, 6, 5> jacobian(const SE3& T_cam_world) const;
  const Vec3& anchor() const { return anchor_; }

 private:
  Eigen::Matrix<double, 3, 2> tangents(const Vec3& direction) const;
  Vec3 anchor_;
  double radius_;
};
std::unique_ptr<ceres::Manifold> make_sphere_manifold(const SphereStep& step);

/// x + M d: a lens of which some parameters are held and some tied. \pre M has fewer columns than rows, at
/// least one
std::unique_ptr<ceres::Manifold> make_linear_manifold(const MatX& M);

}  // namespace plumbline::detail
