// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <gtest/gtest.h>

#include <filesystem>
#include <optional>
#include <string>

#include "plumbline/core/types.hpp"

namespace plumbline::test {

/// A fresh directory that is removed with the object.
class TempDir {
 public:
  TempDir();
  ~TempDir();
  TempDir(const TempDir&) = delete;
  TempDir& operator=(const TempDir&) = delete;
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

/// A folder of the optional data sets (environment variable PLUMBLINE_DATA), nullopt when they are not there.
/// With PLUMBLINE_REQUIRE_DATA=1, as in CI, their absence is a failure instead.
std::optional<std::filesystem::path> data_dir(const std::string& folder);

/// The left/right photographs of Debian's opencv-doc (environment variable PLUMBLINE_DEMO_IMAGES, set by
/// ./dev).
std::optional<std::filesystem::path> demo_images();

/// Use as: const auto dir = data_dir("x"); PLUMBLINE_NEEDS(dir);
#define PLUMBLINE_NEEDS(dir) \
  if (!(dir)) GTEST_SKIP() << "the data set is not here (PLUMBLINE_DATA, PLUMBLINE_DEMO_IMAGES)"

std::string read_text(const std::filesystem::path& file);
void write_text(const std::filesystem::path& file, const std::string& text);

/// Runs a shell command; what it printed and how it ended.
struct Run {
  int exit_code = -1;
  std::string out, err;
};
Run run(const std::string& command);

/// The plumbline binary with these arguments.
Run plumbline(const std::string& arguments);

}  // namespace plumbline::test
