// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Blocks of numbers in YAML, read past the parser: it looks at each character with regular expressions, and
/// takes thirty times as long over a file of corners as it takes to copy it.
namespace plumbline::io {

/// A text in which each `key: |` over lines of nothing but numbers has become `key: !plumbline-block N`, with
/// as many empty lines behind it, so that line numbers stay true. The parser decides whether that was a
/// block: inside a quoted text it never announces the tag, and then the text has to be read as it is.
struct LiftedBlocks {
  std::string text;
  std::vector<std::string> blocks;  ///< what the literal scalars say
};
inline constexpr std::string_view kBlockTag = "!plumbline-block";

/// nullopt where there is nothing to lift.
std::optional<LiftedBlocks> lift_blocks(std::string_view text);

}  // namespace plumbline::io
