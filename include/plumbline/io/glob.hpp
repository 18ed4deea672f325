// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "plumbline/core/result.hpp"

namespace plumbline {

/// A file that a pattern matched.
struct GlobMatch {
  std::filesystem::path file;  ///< to open it
  /// To speak of it: the path from the component of the first wildcard on (without a wildcard the file's
  /// name), so that it is the same wherever one stands.
  std::string name;
  /// The text that the wildcards matched, several joined by '/'; without a wildcard the file's stem.
  std::string key;
};

/// The files that match a pattern with the wildcards `*` (any run of characters) and `?` (any one character),
/// in file names and folders; neither matches '/' or a leading '.'. Neighbouring wildcards ("??") count as
/// one. A folder stands for all files in it, whose keys are their stems. In natural order of the name.
/// \returns kIo when a pattern without wildcards names no file, or one with wildcards matches none (says
/// which
///          folder it looked in and what that holds)
Result<std::vector<GlobMatch>> glob_files(std::string_view pattern);

/// The key of `name` under `pattern`, comparing as many trailing path components as the pattern has; nullopt
/// when it does not match. For names in a list of corners, whose files need not exist.
std::optional<std::string> glob_key(std::string_view pattern, std::string_view name);

}  // namespace plumbline
