// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "plumbline/core/result.hpp"

namespace plumbline {

/// One file as it travels: formats turn a rig into these and back, and never touch a disc themselves.
struct NamedBytes {
  std::string name, bytes;
};

/// The whole file; kIo with the operating system's reason. Files over 256 MiB are refused.
Result<std::string> read_file(const std::filesystem::path& file);

/// Writes beside the file and renames, so that the file is whole or absent; kIo (full disc, no permission,
/// file too large) leaves nothing behind. An existing file is replaced only with `force`.
Status write_file(const std::filesystem::path& file, std::string_view bytes, bool force);

/// A directory that appears whole or not at all: write into path(), then commit(). Without commit() (an
/// error, an exception) it vanishes. An existing directory is replaced only with `force`, and only at
/// commit().
class OutputDir {
 public:
  /// kIo when the directory exists and `force` is not set, or the parent cannot be written.
  static Result<OutputDir> create(const std::filesystem::path& directory, bool force);
  OutputDir(OutputDir&&) noexcept;
  OutputDir& operator=(OutputDir&&) noexcept;
  ~OutputDir();
  const std::filesystem::path& path() const { return temporary_; }
  Status write(const std::string& name, std::string_view bytes) const;
  Status commit();

 private:
  OutputDir() = default;
  std::filesystem::path temporary_, final_;
};

}  // namespace plumbline
