// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <vector>

#include "refine/reprojection_cost.hpp"

/// Ceres' costs for lenses with sparse derivatives (CountedLens).
namespace plumbline::detail {

/// As make_view_cost(), through project_sparse(), with the lens' parameters in two blocks, fx fy cx cy and
/// the others: [core (4) | others | T_cam_rig (7) | T_rig_board (7)], of a further board [... |
/// T_board0_board (7)], and of a board whose bow is a parameter [... | bow (2)]. Holding the core then needs
/// no manifold, whose dense product with the others would take nearly all of the time. One cost for each
/// corner lets Ceres see the zeros (Solver::Options::dynamic_sparsity). \param scratch  a lens of this shape,
/// overwritten by each evaluation; costs that share one cannot be evaluated by two threads at a time
std::unique_ptr<ceres::CostFunction> make_sparse_cost(std::shared_ptr<Lens> scratch,
                                                      std::vector<Observation> observations, Loss loss,
                                                      double loss_scale, bool further_board = false,
                                                      bool bowed = false);

/// scale * (row's sum) over the block of the lens' parameters after its core.
std::unique_ptr<ceres::CostFunction> make_prior_cost(const PriorRow& row, int n_params, double scale);

/// What the rows of priors() of one lens are multiplied with, sqrt(n_residuals / (16 (n_params - 4))), as
/// mrcal does: the regularisation does not fade as corners are added, and all corrections of size 4 together
/// cost as much as residuals of 1 px.
double prior_scale(int n_residuals, int n_params);

}  // namespace plumbline::detail
