// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>

#include "io/yaml.hpp"
#include "plumbline/rig/rig.hpp"

/// mrcal's valid_intrinsics_region: a contour in the image inside which a calibration holds. Ours is a cone
/// about the axis, cut by the picture's border.
namespace plumbline::io {

/// "[[x, y], ...]", closed; the camera's validity, or the fold of a lens that turns back inside its picture.
/// nullopt where neither is there.
std::optional<std::string> region_text(const Camera& camera);

/// The widest cone inside a contour; what lies on the border of the picture does not narrow it. nullopt where
/// the contour is the whole picture. Fails when it has fewer than three points, or holds no direction.
std::optional<Validity> read_region(const Field& field, const Camera& camera);

}  // namespace plumbline::io
