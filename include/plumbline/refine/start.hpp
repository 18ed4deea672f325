// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/rig/calibration.hpp"

namespace plumbline {

struct StartFrom {
  /// One for all cameras or one per camera of the data; empty, or an empty name: that of the rig. A lens of
  /// another kind becomes the wanted one by fitting it to the image of the other.
  std::vector<std::string> lenses;
  /// Whether the rig says where its cameras stand (poses_known() of io); otherwise that is found from the
  /// frames that they share.
  bool places_known = true;
  /// Board poses that are known, one per frame of the data (in the frame of `rig`); empty or
  /// nullopt: found.
  std::vector<std::optional<SE3>> T_rig_board;
  std::vector<SE3> T_board0_board;  ///< how several boards stand to one another; empty: found
  int n_threads = 0;                ///< <= 0: all cores
};

/// A start for refine() from cameras that are known: lenses and places of `rig`, and the board poses that fit
/// them. Cameras go by their names, or, when data and rig have one each, belong together. The result has the
/// cameras of the data in their order; the first carries the rig's frame. Corners that contradict their
/// neighbours take no part in finding poses. kInvalidData: a camera that the rig does not have, or of another
/// image size; kUnsupported: no lens of that name; kNotConverged: a lens that cannot be fitted to the other,
/// or no pose at all; kDegenerate as calibrate() when places are not known.
Result<Calibration> start_from(const Dataset& data, const Rig& rig, const StartFrom& options);

/// The lens of this kind that projects most nearly like another over an image: least squares over a grid of
/// 40 x 30 pixels, as far as both see the same rays. Exact when the kind contains the other. kUnsupported: no
/// lens of that name; kNotConverged: no fit.
Result<Lens> convert_lens(const Lens& from, const std::string& lens_name, ImageSize size);

}  // namespace plumbline
