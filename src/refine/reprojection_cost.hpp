// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <memory>
#include <vector>

#include "plumbline/core/types.hpp"
#include "plumbline/lens/lens.hpp"
#include "plumbline/refine/refine.hpp"

namespace ceres {
class CostFunction;
class Manifold;
}  // namespace ceres

namespace plumbline::detail {

/// One corner as the cost sees it.
struct Observation {
  Vec3 p_board;                   ///< [m]
  Vec2 px;                        ///< measured
  double weight = 1.0;            ///< 1, or 1 / sigma_px
  Vec2 bow_shape = Vec2::Zero();  ///< how far each number of the board's bow lifts the point (target/bow.hpp)
};

/// rho(s) of the squared length s of one corner's weighted residual, and rho'(s). rho(s) = s up to the bend.
/// Huber 1964: 2 c sqrt(s) - c^2 beyond s = c^2. Cauchy: c^2 log(1 + s / c^2).
struct Rho {
  double value = 0, derivative = 1;
};
Rho rho(Loss loss, double scale, double s);

/// f = sqrt(rho(s) / s), with which a residual is scaled so that its square is rho, and df/ds.
struct Scaling {
  double f = 1, f_s = 0;
};
Scaling scaling_of(Loss loss, double scale, double s);

/// The cost of one view: 2n residuals over the blocks [lens parameters | T_cam_rig (7) | T_rig_board (7)],
/// of a view of a further board [... | T_board0_board (7)], and of a board whose bow is a parameter
/// [... | bow (2)], always last.
///
/// The residual of a corner is r' = f r with r = weight * (projection - measured) and f = sqrt(rho(|r|^2) /
/// |r|^2). Then |r'|^2 = rho(|r|^2) per CORNER, so that Ceres' cost, half the sum of squares, is exactly half
/// the sum of rho, and one bad corner does not weaken the other corners of its view (a ceres::LossFunction
/// would act on the view as a whole). Its Jacobian f J + r (df/ds) (2 r' J) is exact.
///
/// Poses are stored as 7 doubles and stepped in 6 (see make_pose_manifold): the cost writes d(r')/d[dw | dt]
/// into the first six of the seven ambient columns and zero into the last.
///
/// Evaluate returns false when any corner leaves the lens' domain: Ceres then rejects the step.
/// PLUMBLINE_CHECK: not for a lens with sparse derivatives (sparse_cost.hpp).
std::unique_ptr<ceres::CostFunction> make_view_cost(const Lens& lens, std::vector<Observation> observations,
                                                    Loss loss, double loss_scale, bool further_board = false,
                                                    bool bowed = false);

/// Steps an SE3 by box_plus in the components of [dw | dt] that are not held.
///
/// Ceres multiplies the cost's ambient Jacobian (2n x 7) with this manifold's PlusJacobian (7 x 6). Because
/// the cost writes derivatives with respect to the STEP into the first six columns, PlusJacobian is [I6; 0],
/// and no derivative of a quaternion appears anywhere. Only the product of the two has a meaning.
///
/// A rotation of which some but not all components are held is stepped in its rotation vector w = log(R)
/// instead, w <- w + d, with dw = J_l(w) d, so that the held components of log(R) stay what they were.
std::unique_ptr<ceres::Manifold> make_pose_manifold(const std::array<bool, 6>& held = {});

}  // namespace plumbline::detail
