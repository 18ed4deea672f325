// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <string_view>
#include <vector>

#include "plumbline/core/types.hpp"

namespace plumbline::detail {

/// `text` as polylines, so that a print does not depend on the fonts of the machine. Starts at (0, 0), y
/// down; a capital is `height` high with its foot at y = 0. Upper case is drawn as lower case; unknown
/// characters are left blank.
std::vector<std::vector<Vec2>> text_strokes(std::string_view text, double height);

/// Width of the text in the unit of `height`.
double text_width(std::string_view text, double height);

}  // namespace plumbline::detail
