// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <ceres/cost_function.h>
#include <ceres/manifold.h>

#include <memory>
#include <vector>

/// Ties across parameter blocks, for Ceres: all shared parameters in one block, whose manifold moves them
/// together.
namespace plumbline::detail {

/// `inner` seen over another division of its parameters. offset[b] >= 0: its block b lies there in a first
/// block of `size` numbers; -1: it stays a block of its own, after the first in the same order.
std::unique_ptr<ceres::CostFunction> merge_blocks(std::unique_ptr<ceres::CostFunction> inner,
                                                  std::vector<int> offset, int size);

/// Blocks side by side, each stepped by its manifold, where entry i of all their steps in a row is number
/// column[i] of the step, or zero for -1. \param n_free  the numbers of a step, >= 1
std::unique_ptr<ceres::Manifold> make_tied_manifold(std::vector<std::unique_ptr<ceres::Manifold>> parts,
                                                    std::vector<int> column, int n_free);

/// r = weight (x_i - value) over a block of plain numbers.
std::unique_ptr<ceres::CostFunction> make_prior_cost(int block_size, int i, double value, double weight);

/// The same over a pose (7), i counting [rotation vector | translation]; derivatives as make_view_cost()
/// gives them, by the step.
std::unique_ptr<ceres::CostFunction> make_pose_prior_cost(int i, double value, double weight);

}  // namespace plumbline::detail
