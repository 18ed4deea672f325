// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <string_view>

#include "io/yaml.hpp"

namespace plumbline::io {

/// A Python literal (dict, list, tuple, strings, bytes, numbers, True, False, None; comments) as the same
/// tree that YAML gives: what ast.literal_eval would accept of a .cameramodel. kParse names the line. Nesting
/// over 32 levels and more than two million values are refused.
Result<std::unique_ptr<YamlNode>> parse_python_literal(std::string_view text);

}  // namespace plumbline::io
