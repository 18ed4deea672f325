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
/// \param replace  whether a view of a camera and an image that are there already takes the place of the old
/// one \returns kInvalidData: another target, a camera that the old calibration does not have (or of another
/// image size), images that are there already and not to be replaced (named), and what validate() says
Result<Calibration> add_views(const Calibration& old, const Dataset& more, bool replace);

}  // namespace plumbline
