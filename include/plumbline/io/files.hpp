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
/// file too large) leaves nothing behind. An existing file is replaced only with `force`. A device or a pipe
/// (/dev/stdout) is written into, never replaced. A symbolic link stays, and the file it points to is
/// written. Under a limit of file size (ulimit -f) the system also sends SIGXFSZ, which ends a program that
/// does not ignore it: main() must.
Status write_file(const std::filesystem::path& file, std::string_view bytes, bool force);

/// A directory that appears whole or not at all: write into path(), then commit(). Without commit() (an
/// error, an exception) it vanishes. An existing directory is replaced only with `force`, and only at
/// commit(); when that fails the old one is still there. It is replaced only when all that is in it may be
/// Plumbline's (the names of its results, camera files, one level of folders of .png files). Until then the
/// files are in a hidden sibling
/// (".plumbline-PID-N"); a killed program leaves that one behind.
class OutputDir {
 public:
  /// kIo when the directory exists and `force` is not set, when it is a file, when it is the working or the
  /// home directory or above one of them, when it holds a file that is not ours (which is named), or when its
  /// parent cannot be written. Missing parents are made too, and vanish
  /// again without commit().
  static Result<OutputDir> create(const std::filesystem::path& directory, bool force);
  OutputDir(OutputDir&&) noexcept;
  OutputDir& operator=(OutputDir&&) noexcept;
  ~OutputDir();
  const std::filesystem::path& path() const { return temporary_; }
  /// Writes path() / name, where `name` may have folders of its own; kInvalidData when it would leave the
  /// directory.
  Status write(const std::string& name, std::string_view bytes) const;
  /// Gives the directory its name; kIo as create() when something foreign came in the meantime. \pre not
  /// committed yet
  Status commit();

 private:
  OutputDir() = default;
  void discard() noexcept;
  std::filesystem::path temporary_, final_;
  std::vector<std::filesystem::path> made_parents_;  // deepest first
  bool force_ = false;
};

}  // namespace plumbline
