// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "io/formats/common.hpp"
#include "plumbline/core/text.hpp"

/// ROS CameraInfo as YAML (camera_calibration_parsers): one file per camera. R maps camera to rectified, P
/// projects points of the FIRST camera's rectified frame, so a pair's baseline is in P of the second: P[3] =
/// -fx' B for cameras side by side. A camera without rectification has R = I and P = [K | 0].
/// sensor_msgs/CameraInfo defines the fields.
namespace plumbline::io {
namespace {

struct Distortion {
  std::string_view model;
  std::vector<double> d;
};

std::optional<Distortion> distortion_of(const Lens& lens) {
  if (lens_name(lens) == KannalaBrandt4::kName) {
    const auto all = params(lens);
    return Distortion{"equidistant", {all.begin() + 4, all.end()}};
  }
  if (auto d = brown_coefficients(lens, 5)) return Distortion{"plumb_bob", *d};
  if (auto d = brown_coefficients(lens, 8)) return Distortion{"rational_polynomial", *d};
  return std::nullopt;
}

std::string matrix_text(std::string_view key, const std::vector<double>& row_major_values, std::size_t rows) {
  return fmt::format("{}:\n  rows: {}\n  cols: {}\n  data: {}\n", key, rows, row_major_values.size() / rows,
                     yaml_numbers(row_major_values));
}

Result<std::vector<NamedBytes>> write(const Rig& rig, const WriteOptions& options) {
  std::vector<NamedBytes> files;
  const auto stems = file_stems(rig);
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    const Camera& camera = rig.cameras[i];
    const auto distortion = distortion_of(camera.lens);
    if (!distortion) return unsupported_lens(kRosFormat, camera);
    const Mat3 K = camera_matrix_k(camera.lens);
    Mat3 R = Mat3::Identity();
    Mat34 P;
    P << K, Vec3::Zero();
    if (options.rectification && i < 2) {
      const ImageSize rectified = options.rectification->size;
      if (!(rectified == camera.size)) {
        return Error{
            ErrorCode::kUnsupported,
            fmt::format("CameraInfo has one size for the raw and the rectified image, here {}x{} and {}x{}; "
                        "rectify to the camera's own size",
                        camera.size.width, camera.size.height, rectified.width, rectified.height),
            "camera " + camera.name};
      }
      R = options.rectification->R_rect_cam[i];
      P = options.rectification->P[i];
    }
    std::string out = fmt::format("image_width: {}\nimage_height: {}\ncamera_name: {}\n", camera.size.width,
                                  camera.size.height, yaml_text(camera.name));
    out += matrix_text("camera_matrix", row_major(K), 3);
    out += fmt::format("distortion_model: {}\n", distortion->model);
    out += matrix_text("distortion_coefficients", distortion->d, 1);
    out += matrix_text("rectification_matrix", row_major(R), 3);
    out += matrix_text("projection_matrix", row_major(P), 3);
    files.push_back({stems[i] + ".yaml", out});
  }
  return files;
}

std::vector<double> matrix_values(const Field& root, const char* key, int n) {
  return root.at(key).at("data").numbers(n);
}

Lens read_lens(const Field& root) {
  const Field matrix = root.at("camera_matrix");
  const std::vector<double> K = matrix_values(root, "camera_matrix", 9);
  if (K[0] == 0) matrix.fail("fx is 0: this camera was never calibrated", ErrorCode::kInvalidData);
  const std::vector<double> k4 = focal_and_centre(matrix, K);
  const auto model = root.find("distortion_model");
  const std::string name = model ? model->text() : "plumb_bob";
  const Field field = root.at("distortion_coefficients");
  std::vector<double> d = field.at("data").numbers();
  if (name == "equidistant" || name == "fisheye") {  // "fisheye" was ROS 1's word for a while
    if (d.size() != 4)
      root.fail(fmt::format("distortion_model {} has 4 coefficients, there are {}", name, d.size()));
    return lens_of(field, "kb4", k4, d);
  }
  if (name != "plumb_bob" && name != "rational_polynomial") {
    model->fail(
        fmt::format(
            "distortion model '{}' is not known; known are: plumb_bob, rational_polynomial, equidistant",
            name.substr(0, 40)),
        ErrorCode::kUnsupported);
  }
  if (name == "plumb_bob" && d.size() == 5 && d[4] == 0) d.pop_back();  // a filled-up opencv4
  return brown_lens(field, k4, d);
}

/// One camera, and where its rectified frame stands.
struct CameraInfo {
  Camera camera;
  SE3 T_cam_rect1;  ///< from the first camera's rectified frame, by R and P
  bool has_baseline = false;
};

Result<CameraInfo> read_info(const Field& root, const std::string& file) {
  if (!root.is_map()) root.fail("not a CameraInfo: a map is needed");
  const auto name = root.find("camera_name");
  CameraInfo info{{name ? name->text() : stem_of(file),
                   size_of(root.at("image_width"), root.at("image_height")), read_lens(root)},
                  {},
                  false};
  const std::vector<double> P = matrix_values(root, "projection_matrix", 12);
  const SE3 T_rect_cam =
      pose_of(root.at("rectification_matrix"), matrix_values(root, "rectification_matrix", 9), {0, 0, 0});
  // P [p; 1] = K' (p + t): the second rectified frame is the first one moved by t, in the plane of the image.
  if (P[0] != 0 && P[5] != 0) {
    const SE3 T_rect_rect1(Mat3::Identity(), {P[3] / P[0], P[7] / P[5], 0});
    info.T_cam_rect1 = T_rect_cam.inverse() * T_rect_rect1;
    info.has_baseline = P[3] != 0 || P[7] != 0;
  }
  return info;
}

Result<Rig> read(std::span<const NamedBytes> files) {
  Rig rig;
  std::vector<SE3> T_cam_rect1;
  int n_without_baseline = 0;
  for (const NamedBytes& file : files) {
    auto info = read_yaml<CameraInfo>(file.bytes, file.name,
                                      [&](const Field& root) { return read_info(root, file.name); });
    if (!info) return info.error();
    rig.cameras.push_back(std::move(info->camera));
    T_cam_rect1.push_back(info->T_cam_rect1);
    n_without_baseline += !info->has_baseline;
  }
  rig.T_cam_rig.assign(files.size(), SE3());
  // The first of the rectified cameras has no baseline; a second one without was not rectified with the
  // others, and then nothing says where it stands.
  if (files.size() < 2 || n_without_baseline > 1) return rig;
  rig.T_cam_rig = T_cam_rect1;
  make_first_the_rig(rig);
  return rig;
}

bool recognises(std::string_view bytes) {
  const auto has = [&](std::string_view key) { return bytes.find(key) != std::string_view::npos; };
  return has("camera_matrix:") && !has("opencv-matrix") &&
         (has("projection_matrix:") || has("distortion_model:") || has("rectification_matrix:"));
}

}  // namespace

const Format kRosFormat{"ros",
                        "ROS CameraInfo YAML, with R and P of the rectified pair",
                        "CAMERA.yaml for each camera",
                        "pinhole opencv4 opencv5 opencv8 kb4",
                        false,
                        write,
                        read,
                        recognises};

}  // namespace plumbline::io
