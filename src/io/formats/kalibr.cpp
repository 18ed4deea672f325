// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cmath>

#include "io/formats/common.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/lens/range.hpp"

/// Kalibr's camchain.yaml: cam0, cam1, ...; T_cn_cnm1 maps the camera before to this one, T_cam_imu (of the
/// IMU tool) the IMU to the camera. camera_model-distortion_model: pinhole-radtan is opencv4,
/// pinhole-equidistant is kb4, pinhole-fov is fov, pinhole-none has no distortion; omni-none is ucm in Mei's
/// parameters, omni-radtan is mei; eucm-none and ds-none are eucm and ds. The parameters of omni, eucm and ds
/// stand before the focal lengths.
namespace plumbline::io {
namespace {

std::string pose_text(std::string_view key, const SE3& T) {
  const Mat4 M = T.matrix();
  std::string out = fmt::format("  {}:\n", key);
  for (int r = 0; r < 4; ++r)
    out += fmt::format("  - {}\n", yaml_numbers(std::vector<double>{M(r, 0), M(r, 1), M(r, 2), M(r, 3)}));
  return out;
}

/// A lens in Kalibr's words.
struct Model {
  std::string_view camera, distortion;
  std::vector<double> intrinsics, d;
};

std::vector<double> joined(std::vector<double> a, std::span<const double> b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

std::optional<Model> model_of(const Lens& lens) {
  const std::string_view name = lens_name(lens);
  const std::span<const double> all = params(lens), k4 = all.first(4), rest = all.subspan(4);
  const std::vector<double> f_c(k4.begin(), k4.end()), d(rest.begin(), rest.end());
  if (name == Pinhole::kName) return Model{"pinhole", "none", f_c, {}};
  if (name == KannalaBrandt4::kName) return Model{"pinhole", "equidistant", f_c, d};
  if (name == FieldOfView::kName) return Model{"pinhole", "fov", f_c, {std::abs(d[0])}};
  if (name == Mei::kName) return Model{"omni", "radtan", joined({d[0]}, k4), {d.begin() + 1, d.end()}};
  if (!out_of_range(lens).empty()) return std::nullopt;
  if (name == UnifiedCamera::kName) {
    const double xi = d[0] / (1 - d[0]);
    return Model{"omni", "none", {xi, f_c[0] * (1 + xi), f_c[1] * (1 + xi), f_c[2], f_c[3]}, {}};
  }
  if (name == EnhancedUnifiedCamera::kName) return Model{"eucm", "none", joined(d, k4), {}};
  if (name == DoubleSphere::kName) return Model{"ds", "none", joined(d, k4), {}};
  if (auto brown = brown_coefficients(lens, 4)) return Model{"pinhole", "radtan", f_c, *brown};
  return std::nullopt;
}

Result<std::vector<NamedBytes>> write(const Rig& rig, const WriteOptions&) {
  std::string out;
  const auto stems = file_stems(rig);
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    const Camera& camera = rig.cameras[i];
    const auto model = model_of(camera.lens);
    if (!model) return unsupported_lens(kKalibrFormat, camera);
    std::vector<std::string> others;
    for (std::size_t j = 0; j < rig.cameras.size(); ++j) {
      if (j != i) others.push_back(std::to_string(j));
    }
    out += fmt::format("cam{}:\n  cam_overlaps: [{}]\n  camera_model: {}\n", i, join(others, ", "),
                       model->camera);
    out += fmt::format("  distortion_coeffs: {}\n  distortion_model: {}\n", yaml_numbers(model->d),
                       model->distortion);
    out += fmt::format("  intrinsics: {}\n", yaml_numbers(model->intrinsics));
    out += fmt::format("  resolution: [{}, {}]\n", camera.size.width, camera.size.height);
    out += fmt::format("  rostopic: {}\n", yaml_text("/" + stems[i] + "/image_raw"));
    if (i > 0)
      out += pose_text("T_cn_cnm1", relative_pose(rig, static_cast<int>(i) - 1, static_cast<int>(i)));
  }
  if (Status known = check_poses(kKalibrFormat, rig); !known) return known.error();
  return std::vector<NamedBytes>{{"camchain.yaml", out}};
}

[[noreturn]] void fail_unknown(const Field& field, std::string_view what, const std::string& name,
                               std::string_view known) {
  field.fail(fmt::format("{} '{}' is not among our lenses; known are: {}", what, name.substr(0, 40), known),
             ErrorCode::kUnsupported);
}

Lens read_lens(const Field& cam) {
  const std::string model = cam.at("camera_model").text(), distortion = cam.at("distortion_model").text();
  const Field intrinsics = cam.at("intrinsics");
  // Where fu fv pu pv stand in the list, after the model's own numbers.
  const int n_before = model == "pinhole"                 ? 0
                       : model == "omni"                  ? 1
                       : model == "eucm" || model == "ds" ? 2
                                                          : -1;
  if (n_before < 0) fail_unknown(cam.at("camera_model"), "camera model", model, "pinhole, omni, eucm, ds");
  std::vector<double> own = intrinsics.numbers(n_before + 4);
  std::vector<double> k4(own.begin() + n_before, own.end());
  own.resize(static_cast<std::size_t>(n_before));
  const auto coefficients = [&](int n) { return cam.at("distortion_coeffs").numbers(n); };
  if (model == "pinhole") {
    if (distortion == "none") return lens_of(intrinsics, "pinhole", k4, {});
    const Field field = cam.at("distortion_coeffs");
    if (distortion == "radtan") return lens_of(field, "opencv4", k4, coefficients(4));
    if (distortion == "equidistant") return lens_of(field, "kb4", k4, coefficients(4));
    if (distortion == "fov") return lens_of(field, "fov", k4, coefficients(1));
    fail_unknown(cam.at("distortion_model"), "distortion model", distortion,
                 "radtan, equidistant, fov, none");
  }
  if (model == "omni" && distortion == "radtan")
    return lens_of(intrinsics, "mei", k4, joined(own, coefficients(4)));
  if (distortion != "none") {
    fail_unknown(cam.at("distortion_model"), "distortion model", model + "-" + distortion,
                 "omni-radtan, omni-none, eucm-none, ds-none");
  }
  if (model != "omni") return lens_of(intrinsics, model, k4, own);
  if (!(own[0] > -1)) intrinsics.fail(fmt::format("xi = {}: more than -1 is needed", own[0]));
  k4[0] /= 1 + own[0], k4[1] /= 1 + own[0];
  return lens_of(intrinsics, "ucm", k4, {own[0] / (1 + own[0])});
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

const Format kKalibrFormat{
    "kalibr", "Kalibr camchain", "camchain.yaml", "pinhole opencv4 kb4 ucm mei eucm ds fov", true, write,
    read,     recognises};

}  // namespace plumbline::io
