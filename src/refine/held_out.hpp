// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <vector>

#include "plumbline/refine/refine.hpp"
#include "refine/constraints.hpp"

namespace plumbline::detail {

/// One thing that was left out and predicted: a view, or a corner.
struct HeldOut {
  double sum_sq = 0;  ///< of its residual coordinates [px^2, or sigma^2 with use_sigma]
  double n_free = 0;  ///< their number less that of the pose parameters fitted to them
};

/// How a fit without a part of the views is found.
enum class Refit {
  kAuto,    ///< kLinear from 21 views on, where the loss is squared and there are no ties or priors
  kSolve,   ///< solved, and each view left out solved for its pose
  kLinear,  ///< one Gauss-Newton step from the fit to all views, from the reduced normal equations of each
            ///< view
};

/// Errors of one camera's lens on corners that it was not fitted to, in an order that depends on the data and
/// the marks alone, so that two lenses can be paired. Five folds: of views from six on, of corners below.
/// \param fit  an optimum of one camera; its marks say which corners count
/// \param cap  no corner counts with a longer residual, and one that does not project counts with it
///        [px, or sigmas]: a view beyond all others would else decide everything
/// \returns nullopt when a fold has no optimum
std::optional<std::vector<HeldOut>> held_out_errors(const Calibration& fit, const RefineOptions& options,
                                                    const Constraints& constraints, double cap,
                                                    Refit refit = Refit::kAuto);

}  // namespace plumbline::detail
