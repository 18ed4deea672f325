// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/refine/refine.hpp"

namespace plumbline {

/// The lens of each camera, and all that were tried for it.
struct LensChoice {
  std::vector<std::string> lenses;  ///< one per camera
  std::vector<LensTry> tries;       ///< camera by camera, in the order of lens_names()
};

/// Chooses by held-out error, each camera alone. Every lens of the family is fitted to all views, on the
/// corners that the fit of opencv5 keeps (of kb4 where the camera sees far and that fits better); then it is
/// fitted five times more without a fifth of the views each time, and predicts those: their board poses alone
/// are refined, so that 2 n - 6 of a view's 2 n residuals are free. From 21 views on these fits are one
/// Gauss-Newton step. With fewer than six views a fifth of the corners of each is left out instead. Two
/// lenses are compared view by view (corner by corner) on the same corners, which removes what noise they
/// share: of the lenses whose mean error exceeds the least by at most two standard errors of the mean
/// difference, the one with the fewest parameters is taken, and of several such the one with the least error.
/// Where one lens is as good as that for every camera, and has no more parameters than some camera needs by
/// itself, all get it. Out before that, with the reason in its row, is a lens that lacks a parameter which
/// `fixed`, `ties` or `priors` name for this camera (or for no camera, when no other has it), that does not
/// project all of those corners, whose fit has more than three times the least RMS, or whose parameters come
/// out where other software does not take them (out_of_range()).
/// \param options  lenses: "auto" where the choice is wanted, else the lens itself; the rest as for
///        calibrate()
/// \param candidates  empty: all lenses with less than 20 parameters
/// Failures: what calibrate() says of kb4, or of opencv5, when neither can be fitted; kInvalidData when no
/// candidate has a parameter that is named, or the lenses chosen cannot be tied as wanted.
Result<LensChoice> choose_lenses(const Dataset& data, const RefineOptions& options,
                                 const std::vector<std::string>& candidates = {});

}  // namespace plumbline
