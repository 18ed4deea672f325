// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "plumbline/core/result.hpp"
#include "plumbline/target/target.hpp"

namespace plumbline {

/// Three equal boards on the faces of a right-angled corner: a target that is not flat, for a camera matrix
/// from one image. The target's origin is the corner, its x, y and z axes run along the three edges; the
/// boards' printed sides face +z, +x and +y. Each board's SHEET (pattern and margin, see BoardDrawing) ends
/// at the two edges it touches. kInside: the corner of a room, sheets on the positive sides of the axes.
/// kOutside: the corner of a box, sheets on the negative sides. The boards' ids follow each other from the
/// panel's first_id. kUnsupported for a panel that is neither ChArUco nor AprilGrid; kInvalidData as
/// make_target (too few markers).
enum class CornerKind { kInside, kOutside };
Result<BoardRig> corner_rig(const TargetSpec& panel, CornerKind kind);

}  // namespace plumbline
