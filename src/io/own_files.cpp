// SPDX-License-Identifier: Apache-2.0
#include "io/own_files.hpp"

#include <algorithm>
#include <array>
#include <string_view>
#include <system_error>
#include <vector>

#include "plumbline/io/files.hpp"
#include "plumbline/io/formats.hpp"

namespace plumbline::io {
namespace fs = std::filesystem;
namespace {

constexpr std::array<std::string_view, 12> kNames{"calibration.yaml",   "corners.yaml",     "truth.yaml",
                                                  "rectification.yaml", "undistorted.yaml", "intrinsics.yml",
                                                  "extrinsics.yml",     "camchain.yaml",    "cameras.txt",
                                                  "images.txt",         "points3D.txt",     "report.html"};

/// Everything in a folder by name, so that the answer does not depend on the file system; nullopt when it
/// cannot be read.
std::optional<std::vector<fs::directory_entry>> entries_of(const fs::path& folder) {
  std::vector<fs::directory_entry> all;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
    all.push_back(*it);
  if (error) return std::nullopt;
  std::sort(all.begin(), all.end());
  return all;
}

/// A link is none of ours, wherever it leads.
bool has_type(const fs::directory_entry& entry, fs::file_type type) {
  std::error_code ignored;
  return entry.symlink_status(ignored).type() == type;
}

/// A camera file bears the camera's name, which can be any: what it holds tells. The user's own target in a
/// board.yaml is not one.
bool is_camera_file(const fs::path& file) {
  const fs::path extension = file.extension();
  if (extension != ".yaml" && extension != ".yml" && extension != ".cameramodel") return false;
  const auto bytes = read_file(file);
  const auto recognised = [&](const Format* format) { return format->recognises(*bytes); };
  return bytes && std::any_of(formats().begin(), formats().end(), recognised);
}

}  // namespace

std::optional<fs::path> foreign_file(const fs::path& directory) {
  const auto entries = entries_of(directory);
  if (!entries) return fs::path(".");
  for (const fs::directory_entry& entry : *entries) {
    const fs::path name = entry.path().filename();
    if (has_type(entry, fs::file_type::regular)) {
      const bool known = std::find(kNames.begin(), kNames.end(), name.string()) != kNames.end() ||
                         (name.string().starts_with("contact_sheet") && name.extension() == ".png");
      if (known || is_camera_file(entry.path())) continue;
      return name;
    }
    if (!has_type(entry, fs::file_type::directory)) return name;
    const auto images = entries_of(entry.path());
    if (!images) return name;
    for (const fs::directory_entry& image : *images) {
      if (has_type(image, fs::file_type::regular) && image.path().extension() == ".png") continue;
      return name / image.path().filename();
    }
  }
  return std::nullopt;
}

}  // namespace plumbline::io
