// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "io/formats/common.hpp"
#include "plumbline/core/text.hpp"

/// Kalibr's camchain.yaml: cam0, cam1, ...; T_cn_cnm1 maps the camera before to this one, T_cam_imu (of the
/// IMU tool) the IMU to the camera. pinhole-radtan is opencv4, pinhole-equidistant is kb4, pinhole-none has
/// no distortion.
namespace plumbline::io {
namespace {

std::string pose_text(std::string_view key, const SE3& T) {
  const Mat4 M = T.matrix();
  std::string out = fmt::format("  {}:\n", key);
  for (int r = 0; r < 4; ++r)
    out += fmt::format("  - {}\n", yaml_numbers(std::vector<double>{M(r, 0), M(r, 1), M(r, 2), M(r, 3)}));
  return out;
}

struct Distortion {
  std::string_view model;
  std::vector<double> d;
};

std::optional<Distortion> distortion_of(const Lens& lens) {
  if (lens_name(lens) == Pinhole::kName) return Distortion{"none", {}};
  if (lens_name(lens) == KannalaBrandt4::kName) {
    const auto all = params(lens);
    return Distortion{"equidistant", {all.begin() + 4, all.end()}};
  }
  if (auto d = brown_coefficients(lens, 4)) return Distortion{"radtan", *d};
  return std::nullopt;
}

Result<std::vector<NamedBytes>> write(const Rig& rig, const WriteOptions&) {
  std::string out;
  const auto stems = file_stems(rig);
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    const Camera& camera = rig.cameras[i];
    const auto distortion = distortion_of(camera.lens);
    if (!distortion) return unsupported_lens(kKalibrFormat, camera);
    std::vector<std::string> others;
    for (std::size_t j = 0; j < rig.cameras.size(); ++j) {
      if (j != i) others.push_back(std::to_string(j));
    }
    out += fmt::format("cam{}:\n  cam_overlaps: [{}]\n  camera_model: pinhole\n", i, join(others, ", "));
    out += fmt::format("  distortion_coeffs: {}\n  distortion_model: {}\n", yaml_numbers(distortion->d),
                       distortion->model);
    out += fmt::format("  intrinsics: {}\n", yaml_numbers(params(camera.lens).data(), 4));
    out += fmt::format("  resolution: [{}, {}]\n", camera.size.width, camera.size.height);
    out += fmt::format("  rostopic: {}\n", yaml_text("/" + stems[i] + "/image_raw"));
    if (i > 0)
      out += pose_text("T_cn_cnm1", relative_pose(rig, static_cast<int>(i) - 1, static_cast<int>(i)));
  }
  if (Status known = check_poses(kKalibrFormat, rig); !known) return known.error();
  return std::vector<NamedBytes>{{"camchain.yaml", out}};
}

Lens read_lens(const Field& cam) {
  const std::string model = cam.at("camera_model").text();
  if (model != "pinhole") {
    cam.at("camera_model")
        .fail(
            fmt::format("camera model '{}' is not among our lenses; known is: pinhole", model.substr(0, 40)),
            ErrorCode::kUnsupported);
  }
  const Field intrinsics = cam.at("intrinsics");
  const std::vector<double> k4 = intrinsics.numbers(4);
  const std::string distortion = cam.at("distortion_model").text();
  const auto coefficients = [&](int n) { return cam.at("distortion_coeffs").numbers(n); };
  if (distortion == "none") return lens_of(intrinsics, "pinhole", k4, {});
  if (distortion == "radtan") return lens_of(cam.at("distortion_coeffs"), "opencv4", k4, coefficients(4));
  if (distortion == "equidistant") return lens_of(cam.at("distortion_coeffs"), "kb4", k4, coefficients(4));
  cam.at("distortion_model")
      .fail(fmt::format("distortion model '{}' is not among our lenses; known are: radtan, equidistant, none",
                        distortion.substr(0, 40)),
            ErrorCode::kUnsupported);
}

/// "left" of "/camera/left/image_raw": the word before the last; nothing where there is none.
std::string name_of_topic(const Field& cam) {
  const auto topic = cam.find("rostopic");
  const auto words = split(topic ? topic->text() : "", '/');
  return words.size() >= 2 ? words[words.size() - 2] : "";
}

/// T_cn_c(n-1) as the file gives it: straight, or through the IMU.
SE3 read_step(const Field& previous, const Field& cam) {
  if (const auto T = cam.find("T_cn_cnm1")) return pose_of(*T);
  const auto T_cam_imu = cam.find("T_cam_imu"), T_previous_imu = previous.find("T_cam_imu");
  if (!T_cam_imu || !T_previous_imu)
    cam.fail("'T_cn_cnm1' is missing (and so is T_cam_imu): where does this camera stand?");
  return pose_of(*T_cam_imu) * pose_of(*T_previous_imu).inverse();
}

/// A file that was cut off after a camera still speaks of the others.
void check_overlaps(const Field& root, std::size_t n_cameras) {
  for (std::size_t i = 0; i < n_cameras; ++i) {
    const auto overlaps = root.at(fmt::format("cam{}", i)).find("cam_overlaps");
    for (double other : overlaps ? overlaps->numbers() : std::vector<double>{}) {
      if (other >= 0 && other < static_cast<double>(n_cameras)) continue;
      overlaps->fail(
          fmt::format("cam{} is not in the file, which has {} cameras; is it cut off?", other, n_cameras));
    }
  }
}

Result<Rig> read_chain(const Field& root) {
  if (!root.is_map() || !root.has("cam0")) root.fail("not a camchain: it has no 'cam0'");
  Rig rig;
  std::optional<Field> previous;
  for (int i = 0; const auto cam = root.find(fmt::format("cam{}", i)); ++i) {
    const Field size = cam->at("resolution");
    const std::vector<Field> wh = size.items();
    if (wh.size() != 2) size.fail("[width, height] is needed");
    std::string name = name_of_topic(*cam);
    if (name.empty() || rig.find(name)) name = fmt::format("cam{}", i);
    rig.cameras.push_back({name, size_of(wh[0], wh[1]), read_lens(*cam)});
    rig.T_cam_rig.push_back(previous ? read_step(*previous, *cam) * rig.T_cam_rig.back() : SE3());
    previous = cam;
  }
  check_overlaps(root, rig.cameras.size());
  return rig;
}

Result<Rig> read(std::span<const NamedBytes> files) {
  if (files.size() != 1)
    return Error{ErrorCode::kInvalidData, "one camchain.yaml holds a whole rig; give one", files[1].name};
  return read_yaml<Rig>(files[0].bytes, files[0].name, read_chain);
}

bool recognises(std::string_view bytes) {
  return bytes.find("cam0:") != std::string_view::npos &&
         bytes.find("camera_model:") != std::string_view::npos;
}

}  // namespace

const Format kKalibrFormat{"kalibr", "Kalibr camchain", "camchain.yaml", "pinhole opencv4 kb4", true, write,
                           read,     recognises};

}  // namespace plumbline::io
