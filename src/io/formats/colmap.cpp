// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cmath>
#include <map>

#include "io/dataset_yaml.hpp"
#include "io/formats/colmap.hpp"
#include "plumbline/core/text.hpp"

/// COLMAP's cameras.txt: `CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]`. The centre of its top-left pixel is (0.5,
/// 0.5), so cx and cy are half a pixel larger than ours. The file has no poses (COLMAP keeps those with its
/// images).
namespace plumbline::io {
namespace {

constexpr int kMaxCameras = 10000;

struct Model {
  std::string_view name;
  std::vector<double> d;
};

std::optional<Model> model_of(const Lens& lens) {
  if (lens_name(lens) == Pinhole::kName) return Model{"PINHOLE", {}};
  if (lens_name(lens) == KannalaBrandt4::kName) {
    const auto all = params(lens);
    return Model{"OPENCV_FISHEYE", {all.begin() + 4, all.end()}};
  }
  const std::span<const double> rest = params(lens).subspan(4);
  if (lens_name(lens) == FieldOfView::kName) return Model{"FOV", {std::abs(rest[0])}};
  if (lens_name(lens) == Division::kName) return Model{"DIVISION", {rest[0]}};
  if (lens_name(lens) == UnifiedCamera::kName) return Model{"EUCM", {rest[0], 1}};
  if (lens_name(lens) == EnhancedUnifiedCamera::kName) return Model{"EUCM", {rest[0], rest[1]}};
  if (auto d = brown_coefficients(lens, 4)) return Model{"OPENCV", *d};
  if (auto d = brown_coefficients(lens, 8)) return Model{"FULL_OPENCV", *d};
  return std::nullopt;
}

Result<std::vector<NamedBytes>> write(const Rig& rig, const WriteOptions&) {
  std::string out = "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n";
  out += fmt::format("# Number of cameras: {}\n", rig.cameras.size());
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    const auto line = colmap_camera_line(static_cast<std::int64_t>(i) + 1, rig.cameras[i]);
    if (!line) return line.error();
    out += *line;
  }
  return std::vector<NamedBytes>{{"cameras.txt", out}};
}

/// Where each of our parameters stands in COLMAP's list (-1: zero).
struct Layout {
  std::string_view lens;
  std::size_t n;           ///< COLMAP's parameters
  std::vector<int> index;  ///< of fx fy cx cy and ours after them
};

const std::map<std::string_view, Layout>& layouts() {
  static const std::map<std::string_view, Layout> all{
      {"SIMPLE_PINHOLE", {"pinhole", 3, {0, 0, 1, 2}}},
      {"PINHOLE", {"pinhole", 4, {0, 1, 2, 3}}},
      {"SIMPLE_RADIAL", {"opencv4", 4, {0, 0, 1, 2, 3, -1, -1, -1}}},
      {"RADIAL", {"opencv4", 5, {0, 0, 1, 2, 3, 4, -1, -1}}},
      {"OPENCV", {"opencv4", 8, {0, 1, 2, 3, 4, 5, 6, 7}}},
      {"FULL_OPENCV", {"opencv8", 12, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}}},
      {"OPENCV_FISHEYE", {"kb4", 8, {0, 1, 2, 3, 4, 5, 6, 7}}},
      {"SIMPLE_RADIAL_FISHEYE", {"kb4", 4, {0, 0, 1, 2, 3, -1, -1, -1}}},
      {"RADIAL_FISHEYE", {"kb4", 5, {0, 0, 1, 2, 3, 4, -1, -1}}},
      {"SIMPLE_FISHEYE", {"kb4", 3, {0, 0, 1, 2, -1, -1, -1, -1}}},
      {"FISHEYE", {"kb4", 4, {0, 1, 2, 3, -1, -1, -1, -1}}},
      {"FOV", {"fov", 5, {0, 1, 2, 3, 4}}},
      {"SIMPLE_DIVISION", {"division", 4, {0, 0, 1, 2, 3}}},
      {"DIVISION", {"division", 5, {0, 1, 2, 3, 4}}},
      {"EUCM", {"eucm", 6, {0, 1, 2, 3, 4, 5}}},
  };
  return all;
}

using Words = std::vector<std::string_view>;

/// A line as a camera; the error has no file in it yet.
Result<Camera> read_camera(const Words& words) {
  const auto fail = [](std::string message, ErrorCode code = ErrorCode::kParse) {
    return Error{code, std::move(message), ""};
  };
  if (words.size() < 5) return fail("CAMERA_ID MODEL WIDTH HEIGHT PARAMS[] are needed");
  const auto layout = layouts().find(words[1]);
  if (layout == layouts().end()) {
    return fail(fmt::format("camera model '{}' is not among our lenses", words[1].substr(0, 40)),
                ErrorCode::kUnsupported);
  }
  const auto width = parse_int(words[2]), height = parse_int(words[3]);
  if (!width || !height || *width < 1 || *height < 1)
    return fail("the size of the images is needed, two whole numbers");
  const auto& [lens_type, n, index] = layout->second;
  if (words.size() != 4 + n)
    return fail(fmt::format("{} has {} parameters, there are {}", words[1], n, words.size() - 4));
  std::vector<double> values;
  for (int i : index) {
    const auto value = i < 0 ? std::optional(0.0) : parse_double(words[4 + static_cast<std::size_t>(i)]);
    if (!value)
      return fail(fmt::format("a finite number is needed, not '{}'",
                              words[4 + static_cast<std::size_t>(i)].substr(0, 40)));
    values.push_back(*value);
  }
  values[2] -= kColmapPixelShift;
  values[3] -= kColmapPixelShift;
  std::string_view name = lens_type;
  if (name == "opencv8" && values[9] == 0 && values[10] == 0 && values[11] == 0) {  // an opencv5, filled up
    name = "opencv5";
    values.resize(9);
  }
  if (name == "eucm" && values[5] == 1) {  // a ucm
    name = "ucm";
    values.resize(5);
  }
  auto lens = make_lens(name, values);
  if (!lens) return lens.error();
  return Camera{fmt::format("camera{}", words[0].substr(0, 20)), {*width, *height}, *lens};
}

/// Adds the cameras of one file. COLMAP writes how many there are in a remark, which tells a file that was
/// cut off.
Status read_file(const NamedBytes& file, Rig& rig) {
  std::optional<Error> failed;
  std::optional<int> n_said;
  int n_read = 0;
  for_each_row(file.bytes, [&](int line, const Words& words) {
    if (words.size() == 5 && words[0] == "#" && words[1] == "Number" && words[3] == "cameras:")
      n_said = parse_int(words[4]);
    if (failed || words[0].front() == '#') return;
    auto camera = read_camera(words);
    if (camera && ++n_read <= kMaxCameras) {
      rig.cameras.push_back(*std::move(camera));
      return;
    }
    failed = camera ? Error{ErrorCode::kUnsupported, fmt::format("more than {} cameras", kMaxCameras), ""}
                    : camera.error();
    failed->where = fmt::format("{}: line {}", file.name, line);
  });
  if (failed) return *failed;
  if (n_said.value_or(n_read) == n_read && file.bytes.ends_with('\n')) return {};
  return Error{ErrorCode::kParse,
               "it has not as many cameras as it says, or its last line does not end; is it cut off?",
               file.name};
}

Result<Rig> read(std::span<const NamedBytes> files) {
  Rig rig;
  for (const NamedBytes& file : files) {
    if (Status added = read_file(file, rig); !added) return added.error();
  }
  if (rig.cameras.empty()) return Error{ErrorCode::kParse, "there is no camera in it", files[0].name};
  rig.T_cam_rig.assign(rig.cameras.size(), SE3());
  return rig;
}

bool recognises(std::string_view bytes) {
  bool first = true, known = false;
  for_each_row(bytes.substr(0, 4096), [&](int, const Words& words) {
    if (!first || words[0].front() == '#') return;
    first = false;
    known = words.size() >= 5 && parse_int(words[0]) && parse_int(words[2]) && parse_int(words[3]);
  });
  return known;
}

}  // namespace

const Format kColmapFormat{"colmap",      "COLMAP cameras.txt (without poses)",
                           "cameras.txt", "pinhole opencv4 opencv5 opencv8 kb4 ucm eucm fov division",
                           false,         write,
                           read,          recognises};

Result<std::string> colmap_camera_line(std::int64_t id, const Camera& camera) {
  const auto model = model_of(camera.lens);
  if (!model) return unsupported_lens(kColmapFormat, camera);
  std::vector<double> values(params(camera.lens).begin(), params(camera.lens).begin() + 4);
  values[2] += kColmapPixelShift;
  values[3] += kColmapPixelShift;
  values.insert(values.end(), model->d.begin(), model->d.end());
  std::string line = fmt::format("{} {} {} {}", id, model->name, camera.size.width, camera.size.height);
  for (double value : values) line += " " + number_text(value);
  return line + "\n";
}

}  // namespace plumbline::io
