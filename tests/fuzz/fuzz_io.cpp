// SPDX-License-Identifier: Apache-2.0
// One libFuzzer target for each reader; the name of the program (fuzz_vnl, fuzz_ros) says which. Besides not
// crashing, what was read must be sound: our own files written again give the same text twice, and a rig that
// was read can be written by its format or is refused.
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <string_view>

#include "plumbline/io/calibration_io.hpp"
#include "plumbline/io/dataset_io.hpp"
#include "plumbline/io/formats.hpp"
#include "plumbline/io/points_io.hpp"
#include "plumbline/io/reconstruction_io.hpp"
#include "plumbline/io/target_io.hpp"
#include "plumbline/io/transform_io.hpp"

namespace {
using namespace plumbline;

void require(bool condition) {
  if (!condition) std::abort();
}

template <class T>
void read_twice(const Result<T>& first, std::string (*format)(const T&),
                Result<T> (*parse)(std::string_view)) {
  if (!first) {
    require(!first.error().message.empty());
    return;
  }
  const std::string text = format(*first);
  const Result<T> second = parse(text);
  require(second.has_value());
  require(format(*second) == text);
}

void read_format(std::string_view name, std::string_view bytes) {
  // A second file of the same bytes reaches what joins several.
  const NamedBytes one{"a/camera.x", std::string(bytes)};
  for (const std::vector<NamedBytes>& files : {std::vector{one}, std::vector{one, one}}) {
    const Result<Rig> rig = read_rig(files, name);
    if (!rig) {
      require(!rig.error().message.empty());
      continue;
    }
    require(!rig->cameras.empty() && rig->T_cam_rig.size() == rig->cameras.size());
    for (const Format* format : formats()) {
      const auto written = format->write(*rig, {});
      require(written || written.error().code == ErrorCode::kUnsupported);
      if (written && format->name == name) require(read_rig(*written, name).has_value());
    }
  }
}

// The three files of a COLMAP model, in one input: after each follows a line "===".
void read_colmap_model(std::string_view bytes) {
  std::vector<NamedBytes> files;
  for (const char* name : {"cameras.txt", "images.txt", "points3D.txt"}) {
    const std::size_t end = std::min(bytes.find("===\n"), bytes.size());
    files.push_back({name, std::string(bytes.substr(0, end))});
    bytes.remove_prefix(std::min(end + 4, bytes.size()));
  }
  const auto scene = parse_colmap_model(files);
  if (!scene) {
    require(!scene.error().message.empty());
    return;
  }
  require(validate(*scene).has_value());
  const auto written = format_colmap_model(*scene);
  if (written) require(parse_colmap_model(*written).has_value());
}

void read_bal(std::string_view text) {
  (void)looks_like_bal(text);
  const auto scene = parse_bal(text);
  if (!scene) {
    require(!scene.error().message.empty());
    return;
  }
  require(validate(*scene).has_value());
  const auto written = format_bal(*scene);
  require(written && parse_bal(*written).has_value());
}

std::string reader_name;  // set once, before the first input
}  // namespace

extern "C" int LLVMFuzzerInitialize(int*, char*** argv) {
  const std::string program = std::filesystem::path((*argv)[0]).filename().string();
  reader_name = program.substr(program.find('_') + 1);
  const bool known = reader_name == "target" || reader_name == "corners" || reader_name == "calibration" ||
                     reader_name == "vnl" || reader_name == "points" || reader_name == "transform" ||
                     reader_name == "any" || reader_name == "bal" || reader_name == "colmap_model" ||
                     find_format(reader_name);
  require(known);
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const std::string& name = reader_name;
  if (name == "target")
    read_twice(parse_target(text), format_target, parse_target);
  else if (name == "corners")
    read_twice(parse_corners(text), format_corners, parse_corners);
  else if (name == "calibration")
    read_twice(parse_calibration(text), format_calibration, parse_calibration);
  else if (name == "vnl")
    (void)parse_vnl(text);
  else if (name == "points")
    read_twice(parse_points(text), format_points, parse_points);
  else if (name == "transform")
    (void)parse_transform(text);
  else if (name == "bal")
    read_bal(text);
  else if (name == "colmap_model")
    read_colmap_model(text);
  else
    read_format(name == "any" ? std::string() : name, text);
  return 0;
}
