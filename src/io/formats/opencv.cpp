// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "io/formats/common.hpp"
#include "io/opencv_matrix.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/geometry/so3.hpp"

/// OpenCV's FileStorage YAML, with the keys that OpenCV's own samples write: one file per camera
/// (samples/cpp/tutorial camera_calibration.cpp), or for a pair intrinsics.yml and extrinsics.yml
/// (samples/cpp/stereo_calib.cpp). The fisheye model of cv::fisheye has four coefficients like opencv4;
/// `fisheye_model: 1` tells them apart, as in the sample.
namespace plumbline::io {
namespace {

/// Always in quotes: FileStorage's plain strings end at more characters than YAML's.
std::string string_text(std::string_view key, std::string_view text) {
  const std::string word = yaml_text(text);
  return fmt::format("{}: {}\n", key, word.front() == '"' ? word : '"' + word + '"');
}

bool is_fisheye(const Lens& lens) { return lens_name(lens) == KannalaBrandt4::kName; }

/// The column of distortion coefficients; a pinhole has five zeros, which every OpenCV function takes.
std::optional<std::vector<double>> coefficients(const Lens& lens) {
  const auto all = params(lens);
  if (is_fisheye(lens)) return std::vector<double>(all.begin() + 4, all.end());
  if (lens_name(lens) == Pinhole::kName) return std::vector<double>(5, 0.0);
  return brown_coefficients(lens);
}

Result<NamedBytes> write_camera(const Rig& rig, std::size_t i, const std::string& stem, double rms_px) {
  const Camera& camera = rig.cameras[i];
  const auto d = coefficients(camera.lens);
  if (!d) return unsupported_lens(kOpencvFormat, camera);
  std::string out = kOpencvHeader + string_text("camera_name", camera.name);
  out += fmt::format("image_width: {}\nimage_height: {}\nfisheye_model: {}\n", camera.size.width,
                     camera.size.height, is_fisheye(camera.lens) ? 1 : 0);
  out += opencv_matrix_text("camera_matrix", row_major(camera_matrix_k(camera.lens)), 3);
  out += opencv_matrix_text("distortion_coefficients", *d, d->size());
  if (rms_px > 0) out += fmt::format("avg_reprojection_error: {}\n", number_text(rms_px));
  if (rig.cameras.size() > 1 && poses_known(rig))
    out += opencv_matrix_text("T_cam_rig", row_major(rig.T_cam_rig[i].matrix()), 4);
  return NamedBytes{stem + ".yml", out};
}

std::string extrinsics_text(const Rig& rig, const WriteOptions& options) {
  const SE3 T = relative_pose(rig, 0, 1);
  std::string out = kOpencvHeader + opencv_matrix_text("R", row_major(T.R()), 3) +
                    opencv_matrix_text("T", row_major(T.t()), 3);
  if (const StereoRectification* r = options.rectification) {
    out += opencv_matrix_text("R1", row_major(r->R_rect_cam[0]), 3) +
           opencv_matrix_text("R2", row_major(r->R_rect_cam[1]), 3);
    out += opencv_matrix_text("P1", row_major(r->P[0]), 3) + opencv_matrix_text("P2", row_major(r->P[1]), 3);
    out += opencv_matrix_text("Q", row_major(r->Q), 4);
  }
  if (is_fisheye(rig.cameras[0].lens)) return out;  // cv::fisheye::stereoCalibrate gives neither E nor F
  const Mat3 E = skew(T.t()) * T.R();
  const Mat3 K1 = camera_matrix_k(rig.cameras[0].lens), K2 = camera_matrix_k(rig.cameras[1].lens);
  Mat3 F = K2.inverse().transpose() * E * K1.inverse();
  if (F(2, 2) != 0) F /= F(2, 2);  // as cv::stereoCalibrate
  return out + opencv_matrix_text("E", row_major(E), 3) + opencv_matrix_text("F", row_major(F), 3);
}

Result<std::vector<NamedBytes>> write_pair(const Rig& rig, const WriteOptions& options) {
  std::string out = kOpencvHeader;
  if (is_fisheye(rig.cameras[0].lens) != is_fisheye(rig.cameras[1].lens)) {
    return Error{
        ErrorCode::kUnsupported,
        "a pair of a fisheye and another lens: no OpenCV function takes one; use one lens for both, or write "
        "each camera by itself",
        "format opencv"};
  }
  out += fmt::format("fisheye_model: {}\n", is_fisheye(rig.cameras[0].lens) ? 1 : 0);
  for (std::size_t i = 0; i < 2; ++i) {
    const Camera& camera = rig.cameras[i];
    const auto d = coefficients(camera.lens);
    if (!d) return unsupported_lens(kOpencvFormat, camera);
    const std::size_t n = i + 1;
    out += string_text(fmt::format("camera_name_{}", n), camera.name);
    if (i == 0 || !(camera.size == rig.cameras[0].size)) {
      const std::string suffix = i == 0 ? "" : "_2";
      out += fmt::format("image_width{}: {}\nimage_height{}: {}\n", suffix, camera.size.width, suffix,
                         camera.size.height);
    }
    out += opencv_matrix_text(fmt::format("M{}", n), row_major(camera_matrix_k(camera.lens)), 3);
    out += opencv_matrix_text(fmt::format("D{}", n), *d, d->size());
  }
  if (options.rms_px > 0) out += fmt::format("avg_reprojection_error: {}\n", number_text(options.rms_px));
  if (Status known = check_poses(kOpencvFormat, rig); !known) return known.error();
  return std::vector<NamedBytes>{{"intrinsics.yml", out}, {"extrinsics.yml", extrinsics_text(rig, options)}};
}

Result<std::vector<NamedBytes>> write(const Rig& rig, const WriteOptions& options) {
  if (rig.cameras.size() == 2) return write_pair(rig, options);
  std::vector<NamedBytes> files;
  const auto stems = file_stems(rig);
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    auto file = write_camera(rig, i, stems[i], options.rms_px);
    if (!file) return file.error();
    files.push_back(*std::move(file));
  }
  return files;
}

// --- reading ---

std::optional<Field> find_any(const Field& root, std::initializer_list<std::string_view> keys) {
  for (std::string_view key : keys) {
    if (auto field = root.find(key)) return field;
  }
  return std::nullopt;
}

/// The values of a matrix of rows x cols; -1: any number.
std::vector<double> matrix_values(const Field& matrix, int rows, int cols) {
  const int r = matrix.at("rows").integer(0, 10000), c = matrix.at("cols").integer(0, 10000);
  if ((rows >= 0 && r != rows) || (cols >= 0 && c != cols))
    matrix.fail(fmt::format("{}x{} numbers are needed, it is {}x{}", rows, cols, r, c));
  return matrix.at("data").numbers(r * c);
}

/// A vector of n numbers, lying or standing.
std::vector<double> vector_values(const Field& matrix, int n = -1) {
  const std::vector<double> values = matrix_values(matrix, -1, -1);
  if (n >= 0 && static_cast<int>(values.size()) != n)
    matrix.fail(fmt::format("{} numbers are needed, there are {}", n, values.size()));
  return values;
}

Lens read_lens(const Field& K, const Field& D, bool fisheye) {
  const std::vector<double> k4 = focal_and_centre(K, matrix_values(K, 3, 3));
  return fisheye ? lens_of(D, "kb4", k4, vector_values(D, 4)) : brown_lens(D, k4, vector_values(D));
}

bool read_fisheye(const Field& root) {
  const auto hint = root.find("fisheye_model");
  return hint && hint->boolean();
}

ImageSize read_size(const Field& root, const std::string& suffix) {
  const auto width = find_any(root, {"image_width" + suffix, "Image_Width" + suffix, "image_Width" + suffix});
  const auto height =
      find_any(root, {"image_height" + suffix, "Image_Height" + suffix, "image_Height" + suffix});
  if (!width || !height) {
    root.fail("the size of the images is missing: add the lines 'image_width: W' and 'image_height: H'",
              ErrorCode::kInvalidData);
  }
  return size_of(*width, *height);
}

/// What one file holds; a rig is put together from several.
struct Pieces {
  std::vector<Camera> cameras;   ///< one, or the two of a pair
  std::optional<SE3> T_cam_rig;  ///< of one camera
  std::optional<SE3> T_2_1;      ///< of a pair
};

Result<Pieces> read_pieces(const Field& root, const std::string& file) {
  Pieces pieces;
  if (!root.is_map()) root.fail("not OpenCV's FileStorage: a map is needed");
  const bool fisheye = read_fisheye(root);
  if (root.has("M1")) {
    for (const char* n : {"1", "2"}) {
      const std::string suffix = n;
      const auto name = root.find("camera_name_" + suffix);
      const bool own_size = suffix == "2" && root.has("image_width_2");
      pieces.cameras.push_back({name            ? name->text()
                                : suffix == "1" ? "left"
                                                : "right",
                                read_size(root, own_size ? "_2" : ""),
                                read_lens(root.at("M" + suffix), root.at("D" + suffix), fisheye)});
    }
  } else if (const auto K = find_any(root, {"camera_matrix", "Camera_Matrix", "cameraMatrix"})) {
    const auto D =
        find_any(root, {"distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist_coeffs"});
    if (!D) root.fail("'distortion_coefficients' is missing; a camera without distortion has zeros");
    const auto name = root.find("camera_name");
    pieces.cameras.push_back(
        {name ? name->text() : stem_of(file), read_size(root, ""), read_lens(*K, *D, fisheye)});
    if (const auto T = root.find("T_cam_rig")) pieces.T_cam_rig = pose_of(T->at("data"));
  }
  if (root.has("R") && root.has("T")) {
    const Field R = root.at("R");
    // A rotation vector is what some versions of the sample keep.
    const std::vector<double> r = vector_values(R), t = vector_values(root.at("T"), 3);
    if (r.size() == 3)
      pieces.T_2_1 = SE3(so3_exp({r[0], r[1], r[2]}), {t[0], t[1], t[2]});
    else
      pieces.T_2_1 = pose_of(R, matrix_values(R, 3, 3), t);
  }
  if (pieces.cameras.empty() && !pieces.T_2_1) {
    root.fail("neither a camera (camera_matrix), nor a pair (M1, D1, M2, D2), nor its poses (R, T)");
  }
  return pieces;
}

Result<Rig> read(std::span<const NamedBytes> files) {
  Rig rig;
  std::optional<SE3> T_2_1;
  std::size_t n_poses = 0;
  for (const NamedBytes& file : files) {
    auto pieces = read_yaml<Pieces>(file.bytes, file.name,
                                    [&](const Field& root) { return read_pieces(root, file.name); });
    if (!pieces) return pieces.error();
    for (Camera& camera : pieces->cameras) {
      rig.cameras.push_back(std::move(camera));
      rig.T_cam_rig.push_back(pieces->T_cam_rig.value_or(SE3()));
    }
    n_poses += pieces->T_cam_rig.has_value();
    if (pieces->T_2_1) T_2_1 = pieces->T_2_1;
  }
  const auto fail = [&](const char* message) {
    return Error{ErrorCode::kInvalidData, message, files[0].name};
  };
  if (rig.cameras.empty())
    return fail("only poses; the file with the cameras (intrinsics.yml) is needed too");
  if (T_2_1 && rig.cameras.size() != 2) return fail("R and T belong to two cameras; give exactly those");
  if (T_2_1) rig.T_cam_rig[1] = *T_2_1;
  // None at all is what OpenCV's own files for single cameras say: poses_known() is false then.
  if (!T_2_1 && n_poses != 0 && n_poses != rig.cameras.size()) {
    return fail("some cameras have a pose (T_cam_rig) and others have none; give files of one rig");
  }
  make_first_the_rig(rig);
  return rig;
}

bool recognises(std::string_view bytes) {
  return bytes.substr(0, 64).find("%YAML:1.0") != std::string_view::npos ||
         bytes.find("!!opencv-matrix") != std::string_view::npos;
}

}  // namespace

const Format kOpencvFormat{"opencv",
                           "OpenCV FileStorage YAML",
                           "CAMERA.yml for each camera, or intrinsics.yml + extrinsics.yml for a pair",
                           "pinhole opencv4 opencv5 opencv8 opencv12 kb4",
                           true,
                           write,
                           read,
                           recognises};

}  // namespace plumbline::io
