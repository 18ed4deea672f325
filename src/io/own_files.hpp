// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <optional>

namespace plumbline::io {

/// The first thing (relative to `directory`, in order of name) that no command of Plumbline leaves in a
/// folder of results, nullopt when all of it may be ours. Ours are files with the names of our results,
/// camera files that a format of the table recognises by their content, and one level of folders that hold
/// .png files and nothing else. What cannot be read counts as foreign.
std::optional<std::filesystem::path> foreign_file(const std::filesystem::path& directory);

}  // namespace plumbline::io
