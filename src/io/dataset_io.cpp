// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/dataset_io.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <set>

#include "io/dataset_yaml.hpp"
#include "io/target_yaml.hpp"
#include "plumbline/core/check.hpp"
#include "plumbline/core/text.hpp"

namespace plumbline {
namespace io {

double read_word(const Field& block, int line, std::string_view word) {
  const auto value = parse_double(word);
  if (!value) {
    block.fail(fmt::format("row {}: a finite number is needed, not '{}'", line, word.substr(0, 40)));
  }
  return *value;
}

Corner read_corner(const Field& block, int line, const std::vector<std::string_view>& words) {
  const auto point = parse_int(words[0]);
  if (!point)
    block.fail(
        fmt::format("row {}: the number of a point is needed, not '{}'", line, words[0].substr(0, 40)));
  Corner corner;
  corner.point = *point;
  corner.px = {read_word(block, line, words[1]), read_word(block, line, words[2])};
  corner.sigma_px = read_word(block, line, words[3]);
  return corner;
}

void write_corner(std::string& out, const Corner& corner) {
  char point[16];
  out.append(point, std::to_chars(point, point + sizeof point, corner.point).ptr);
  for (double value : {corner.px.x(), corner.px.y(), corner.sigma_px}) {
    out += ' ';
    append_number(out, value);
  }
}

void check_version(const Field& root, std::string_view key, int newest) {
  const Field version = root.at(key);
  const int number = version.integer(1, 1'000'000);
  if (number > newest) {
    version.fail(
        fmt::format("version {} was written by a newer Plumbline; this one reads up to {}", number, newest),
        ErrorCode::kUnsupported);
  }
}

Contents contents_of(const Dataset& data) {
  std::size_t corners = 0;
  for (const View& view : data.views) corners += view.corners.size();
  return {static_cast<int>(data.cameras.size()), static_cast<int>(data.frames.size()),
          static_cast<int>(data.views.size()), static_cast<int>(corners)};
}

std::string contents_text(const Contents& contents) {
  return fmt::format("{{cameras: {}, frames: {}, views: {}, corners: {}}}", contents.cameras, contents.frames,
                     contents.views, contents.corners);
}

void check_contents(const Field& root, const Contents& found, std::string_view whole_text) {
  const auto field = root.find("contents");
  if (!field) return;
  field->only({"cameras", "frames", "views", "corners"});
  const Contents said{field->at("cameras").integer(), field->at("frames").integer(),
                      field->at("views").integer(), field->at("corners").integer()};
  const std::string is = contents_text(found);
  if (contents_text(said) != is || !whole_text.ends_with('\n')) {
    field->fail("the file is cut off or was changed: it should hold this, and it holds " + is);
  }
}

CameraInfo read_camera_info(const Field& field) {
  field.only({"name", "width", "height"});
  return {field.at("name").text(),
          {field.at("width").integer(1, 1'000'000), field.at("height").integer(1, 1'000'000)}};
}

std::string camera_info_text(const CameraInfo& camera) {
  return fmt::format("{{name: {}, width: {}, height: {}}}", yaml_text(camera.name), camera.size.width,
                     camera.size.height);
}

int index_of(const Field& name, const std::vector<std::string>& names, std::string_view what) {
  const std::string word = name.text();
  const auto found = std::find(names.begin(), names.end(), word);
  if (found == names.end()) name.fail(fmt::format("there is no {} '{}'", what, word.substr(0, 80)));
  return static_cast<int>(found - names.begin());
}

std::vector<std::string> unique_names(const Field& list, const std::vector<std::string>& names) {
  std::set<std::string_view> seen;
  for (const std::string& name : names) {
    if (!seen.insert(name).second) list.fail(fmt::format("the name '{}' is there twice", name.substr(0, 80)));
  }
  return names;
}

std::vector<Target> read_targets(const Field& root) {
  if (!root.has("targets")) return {read_target(root.at("target"))};
  if (root.has("target")) root.fail("both 'target' and 'targets' are given");
  std::vector<Target> targets;
  std::vector<std::string> names;
  for (const Field& item : root.at("targets").items()) {
    targets.push_back(read_target(item));
    names.push_back(targets.back().name);
  }
  if (targets.empty()) root.at("targets").fail("there is no target");
  unique_names(root.at("targets"), names);
  return targets;
}

void write_targets(std::string& out, const std::vector<Target>& targets) {
  if (targets.size() == 1) {
    out += "target:\n";
    write_target(out, "  ", targets[0]);
    return;
  }
  out += "targets:\n";
  for (const Target& target : targets) {
    out += "  -\n";
    write_target(out, "    ", target);
  }
}

int read_target_of_view(const Field& view, const std::vector<Target>& targets) {
  const auto target = view.find("target");
  if (!target && targets.size() == 1) return 0;
  std::vector<std::string> names;
  for (const Target& t : targets) names.push_back(t.name);
  return index_of(view.at("target"), names, "target");
}

namespace {

constexpr int kCornersVersion = 1;

View read_view(const Field& field, const std::vector<std::string>& cameras,
               const std::vector<std::string>& frames, const std::vector<Target>& targets) {
  field.only({"camera", "frame", "image", "target", "reason", "time_s", "corners"});
  View view;
  view.target = read_target_of_view(field, targets);
  view.cam = index_of(field.at("camera"), cameras, "camera");
  view.frame = index_of(field.at("frame"), frames, "frame");
  view.image = field.at("image").text();
  if (const auto reason = field.find("reason")) view.reason = reason->text();
  if (const auto time = field.find("time_s")) view.time_s = time->number();
  if (const auto block = field.find("corners")) {
    for_each_row(*block, [&](int line, const auto& words) {
      if (words.size() != 4) block->fail(fmt::format("row {}: 'point x y sigma' is needed", line));
      view.corners.push_back(read_corner(*block, line, words));
    });
  }
  return view;
}

Result<Dataset> read_corners(const Field& root, std::string_view whole_text) {
  if (!root.is_map() || !root.has("plumbline_corners"))
    root.fail("not a corners file: it has no 'plumbline_corners'");
  check_version(root, "plumbline_corners", kCornersVersion);
  root.only({"plumbline_corners", "contents", "target", "targets", "detector", "cameras", "frames", "views"});
  Dataset data;
  data.targets = read_targets(root);
  if (const auto detector = root.find("detector")) data.detector = detector->text();
  std::vector<std::string> cameras;
  for (const Field& camera : root.at("cameras").items()) {
    data.cameras.push_back(read_camera_info(camera));
    cameras.push_back(data.cameras.back().name);
  }
  unique_names(root.at("cameras"), cameras);
  for (const Field& frame : root.at("frames").items()) data.frames.push_back(frame.text());
  unique_names(root.at("frames"), data.frames);
  for (const Field& view : root.at("views").items())
    data.views.push_back(read_view(view, cameras, data.frames, data.targets));
  check_contents(root, contents_of(data), whole_text);
  if (Status valid = validate(data); !valid) return valid.error();
  return data;
}

}  // namespace
}  // namespace io

std::string format_corners(const Dataset& data) {
  std::string out =
      "# Plumbline corners: pixels, the centre of the top-left pixel is (0, 0). Rows: point x y sigma.\n";
  out += fmt::format("plumbline_corners: {}\ncontents: {}\n", io::kCornersVersion,
                     io::contents_text(io::contents_of(data)));
  io::write_targets(out, data.targets);
  if (!data.detector.empty()) out += fmt::format("detector: {}\n", io::yaml_text(data.detector));
  out += data.cameras.empty() ? "cameras: []\n" : "cameras:\n";
  for (const CameraInfo& camera : data.cameras) out += fmt::format("  - {}\n", io::camera_info_text(camera));
  std::vector<std::string> frames;
  for (const std::string& frame : data.frames) frames.push_back(io::yaml_text(frame));
  out += fmt::format("frames: [{}]\n", join(frames, ", "));
  out += data.views.empty() ? "views: []\n" : "views:\n";
  for (const View& view : data.views) {
    out += fmt::format("  - camera: {}\n    frame: {}\n    image: {}\n",
                       io::yaml_text(data.cameras.at(view.cam).name), frames.at(view.frame),
                       io::yaml_text(view.image));
    if (data.targets.size() > 1)
      out += fmt::format("    target: {}\n", io::yaml_text(data.targets.at(view.target).name));
    if (!view.reason.empty()) out += fmt::format("    reason: {}\n", io::yaml_text(view.reason));
    if (view.time_s) out += fmt::format("    time_s: {}\n", io::number_text(*view.time_s));
    if (!view.corners.empty()) out += "    corners: |\n";
    for (const Corner& corner : view.corners) {
      out += "      ";
      io::write_corner(out, corner);
      out += '\n';
    }
  }
  return out;
}

Result<Dataset> parse_corners(std::string_view yaml) {
  return io::read_yaml<Dataset>(yaml, "",
                                [&](const io::Field& root) { return io::read_corners(root, yaml); });
}

}  // namespace plumbline
