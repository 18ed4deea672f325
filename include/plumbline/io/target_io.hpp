// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <string_view>

#include "plumbline/core/result.hpp"
#include "plumbline/target/target.hpp"

namespace plumbline {

/// A target from YAML text: ours (`type: chessboard ...`, see docs/target.md) or Kalibr's (`target_type:
/// aprilgrid`, `checkerboard`, `circlegrid`) as it is. kParse names the line or the field.
Result<Target> parse_target(std::string_view yaml);

/// Our YAML form; parse_target gives the same spec back.
std::string format_target(const Target& target);

}  // namespace plumbline
