// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "plumbline/core/result.hpp"
#include "plumbline/rig/calibration.hpp"

namespace plumbline {

/// An earlier calibration with more views: what start_from() and refine() go on from. Rig and board poses are
/// the old ones; new frames and frames with a replaced view have no pose; fits, statistics and covariance are
/// empty.
///
/// New views make new frames, whatever their frames are called ("01" of another folder is another moment; it
/// is named "01 (2)"), except where one replaces a view: then the others of its frame join the old frame.
/// Times of the new views (View::time_s) count from a zero of their own: they are shifted, all by as much, so
/// that they begin ten seconds and more after the old ones and no motion leads from one recording to the
/// other; where some replace views with a time, so that these keep it.
/// \param replace  whether a view of a camera and an image that are there already takes the place of the old
/// one \returns kInvalidData: another target, a camera that the old calibration does not have (or of another
/// image size), images that are there already and not to be replaced (named), images that replace others at
/// times of another recording (named), and what validate() says
Result<Calibration> add_views(const Calibration& old, const Dataset& more, bool replace);

}  // namespace plumbline
