// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <vector>

#include "plumbline/core/types.hpp"

namespace plumbline {

/// The rectangle around the points of a flat target, in its own frame [m].
struct Outline {
  Vec2 low = Vec2::Zero(), high = Vec2::Zero();
};

/// nullopt for points that are not all in the plane z = 0 (to 1e-9 of their extent) or that have no extent in
/// x or y: such a target has no bow.
std::optional<Outline> outline_of(const std::vector<Vec3>& points);

/// How far each number of a board's bow lifts this point: (1 - x'^2, 1 - y'^2), where x' and y' run from -1
/// to 1 across the outline. A bow (b_x, b_y) [m] moves the point to z = b_x (1 - x'^2) + b_y (1 - y'^2), in
/// the board's frame: two parabolas, nothing at the four corners and b_x + b_y in the middle. This is mrcal's
/// calobject_warp.
Vec2 bow_shape(const Outline& outline, const Vec3& p_board);

}  // namespace plumbline
