// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/formats.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <sstream>

#include "plumbline/geometry/so3.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
using test::read_text;
using test::TempDir;
using ::testing::HasSubstr;

const std::string& bytes_of(const std::vector<NamedBytes>& files, const std::string& name) {
  for (const NamedBytes& file : files) {
    if (file.name == name) return file.bytes;
  }
  throw std::runtime_error("no file " + name);
}

std::vector<NamedBytes> written(const std::string& format, const Rig& rig, const WriteOptions& options = {}) {
  return find_format(format)->write(rig, options).value();
}

Camera camera_of(const std::string& name, const std::string& lens, const std::vector<double>& values,
                 ImageSize size = {640, 480}) {
  return {name, size, make_lens(lens, values).value()};
}

Rig stereo(const std::string& lens = "opencv5",
           const std::vector<double>& d = {-0.28, 0.025, 0.0012, -0.00013, 0.16}) {
  Rig rig;
  std::vector<double> left{533, 534, 342, 234}, right{536, 537, 327, 249};
  left.insert(left.end(), d.begin(), d.end());
  right.insert(right.end(), d.begin(), d.end());
  rig.cameras = {camera_of("left", lens, left), camera_of("right", lens, right)};
  rig.T_cam_rig = {SE3(), SE3(so3_exp({0.01, 0.02, -0.003}), {-0.083, 0.0009, -0.00003})};
  return rig;
}

/// A rectified pair side by side, 0.1 m apart, made by hand.
StereoRectification rectification() {
  StereoRectification r;
  r.size = {640, 480};
  r.R_rect_cam = {so3_exp({0.001, -0.02, 0.003}), so3_exp({-0.004, 0.01, 0.002})};
  r.P[0] << 500, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0;
  r.P[1] = r.P[0];
  r.P[1](0, 3) = -500 * 0.1;
  r.Q << 1, 0, 0, -320, 0, 1, 0, -240, 0, 0, 0, 500, 0, 0, 10, 0;
  r.baseline_m = 0.1;
  return r;
}

/// The pair that the rectification above belongs to: p_rect2 = p_rect1 - (0.1, 0, 0).
Rig rectified_pair() {
  Rig rig = stereo();
  const StereoRectification r = rectification();
  const SE3 T_rect2_rect1(Mat3::Identity(), {-0.1, 0, 0});
  rig.T_cam_rig[1] =
      SE3(r.R_rect_cam[1], Vec3::Zero()).inverse() * T_rect2_rect1 * SE3(r.R_rect_cam[0], Vec3::Zero());
  return rig;
}

// --- OpenCV: its own test is in opencv_load_test.cpp; here the text by hand ---

TEST(OpencvFormat, WritesWhatTheSampleWrites) {
  Rig rig;
  rig.cameras = {camera_of("left", "opencv5", {500, 501, 320.5, 240.25, 1, 2, 3, 4, 5})};
  rig.T_cam_rig = {SE3()};
  WriteOptions options;
  options.rms_px = 0.25;
  const auto files = written("opencv", rig, options);
  ASSERT_EQ(files.size(), 1u);
  EXPECT_EQ(files[0].name, "left.yml");
  EXPECT_EQ(
      files[0].bytes,
      "%YAML:1.0\n---\ncamera_name: \"left\"\nimage_width: 640\nimage_height: 480\nfisheye_model: 0\n"
      "camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [500, 0, 320.5, 0, 501, "
      "240.25, 0, 0, 1]\n"
      "distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [1, 2, 3, 4, 5]\n"
      "avg_reprojection_error: 0.25\n");
}

// x2 = R x1 + T: a second camera 10 cm to the right sees everything 10 cm further left.
TEST(OpencvFormat, TIsThePoseOfTheFirstCameraInTheSecond) {
  Rig rig = stereo();
  rig.T_cam_rig[1] = SE3(Mat3::Identity(), {-0.1, 0, 0});
  EXPECT_THAT(
      bytes_of(written("opencv", rig), "extrinsics.yml"),
      HasSubstr(
          "T: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [-0.10000000000000001, 0, 0]\n"));
}

const char* const kOpencvOwn =
    "%YAML:1.0\n---\ncalibration_time: \"Mon 1 Jan 2024 10:00:00\"\nnframes: 13\nimage_width: "
    "640\nimage_height: 480\nboard_width: 9\n"
    "flags: 0\n# flags: \nfisheye_model: 0\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: "
    "d\n"
    "   data: [ 5.3591573396163199e+02, 0., 3.4228315473308373e+02, 0.,\n       5.3591573396163199e+02, "
    "2.3557082909788173e+02, 0., 0., 1. ]\n"
    "distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n"
    "   data: [ -2.6637260909660682e-01, -3.8588898922304653e-02, 1.7831947042852964e-03, "
    "-2.8122100441115472e-04, 2.3839153080878486e-01 ]\n"
    "avg_reprojection_error: 3.9259109564815858e-01\n";

TEST(OpencvFormat, ReadsAFileOfOpencvsSample) {
  const auto rig = read_rig(std::vector<NamedBytes>{{"a/out_camera_data.yml", kOpencvOwn}});
  ASSERT_TRUE(rig) << rig.error().text();
  EXPECT_EQ(rig->cameras[0].name, "out_camera_data");
  EXPECT_EQ(lens_name(rig->cameras[0].lens), "opencv5");
  EXPECT_EQ(params(rig->cameras[0].lens)[0], 5.3591573396163199e+02);
  EXPECT_EQ(params(rig->cameras[0].lens)[3], 2.3557082909788173e+02);
  EXPECT_EQ(params(rig->cameras[0].lens)[8], 2.3839153080878486e-01);
}

TEST(OpencvFormat, FourCoefficientsAreAFisheyeOnlyWhereTheFileSaysSo) {
  std::string text = kOpencvOwn;
  const auto at = text.find("rows: 5");
  text.replace(at, text.find("avg_") - at,
               "rows: 1\n   cols: 4\n   dt: d\n   data: [ 0.1, 0.01, 0.001, 0.0001 ]\n");
  EXPECT_EQ(lens_name(read_rig(std::vector<NamedBytes>{{"a.yml", text}})->cameras[0].lens), "opencv4");
  text.replace(text.find("fisheye_model: 0"), 16, "fisheye_model: 1");
  EXPECT_EQ(lens_name(read_rig(std::vector<NamedBytes>{{"a.yml", text}})->cameras[0].lens), "kb4");
}

TEST(OpencvFormat, SaysWhatIsMissing) {
  const auto files = written("opencv", stereo());
  const auto error_of = [](std::vector<NamedBytes> given) { return read_rig(given).error().text(); };
  EXPECT_THAT(error_of({files[1]}), HasSubstr("intrinsics.yml"));
  EXPECT_THAT(
      error_of(
          {{"a.yml",
            std::string(kOpencvOwn).replace(std::string(kOpencvOwn).find("image_width"), 11, "no_width")}}),
      HasSubstr("image_width: W"));
  std::string tilted = kOpencvOwn;
  const auto at = tilted.find("rows: 5");
  tilted.replace(at, tilted.find("avg_") - at,
                 "rows: 14\n   cols: 1\n   dt: d\n   data: [ 0,0,0,0,0,0,0,0,0,0,0,0,0.1,0 ]\n");
  EXPECT_THAT(error_of({{"a.yml", tilted}}), HasSubstr("tilted sensor"));
  // Either order of the two files is fine.
  EXPECT_TRUE(read_rig(std::vector<NamedBytes>{files[1], files[0]}));
  Rig mixed = stereo();
  mixed.cameras[1] = camera_of("right", "kb4", {500, 500, 320, 240, 0, 0, 0, 0});
  EXPECT_EQ(find_format("opencv")->write(mixed, {}).error().code, ErrorCode::kUnsupported);
}

// --- ROS ---

TEST(RosFormat, CarriesRAndPAndReadsThePairBack) {
  const Rig rig = rectified_pair();
  const StereoRectification r = rectification();
  WriteOptions options;
  options.rectification = &r;
  const auto files = written("ros", rig, options);
  // The sign by hand: the right camera's Tx = -fx' B.
  EXPECT_THAT(bytes_of(files, "right.yaml"), HasSubstr("projection_matrix:\n  rows: 3\n  cols: 4\n  data: "
                                                       "[500, 0, 320, -50, 0, 500, 240, 0, 0, 0, 1, 0]"));
  EXPECT_THAT(bytes_of(files, "left.yaml"), HasSubstr("data: [500, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0]"));
  const auto back = read_rig(files);
  ASSERT_TRUE(back) << back.error().text();
  EXPECT_EQ(back->T_cam_rig[0], SE3());
  EXPECT_LT(box_minus(back->T_cam_rig[1], rig.T_cam_rig[1]).norm(), 1e-14);
  // The right camera first: the rig is then the right one's.
  const auto turned = read_rig(std::vector<NamedBytes>{files[1], files[0]});
  EXPECT_LT(box_minus(turned->T_cam_rig[1], rig.T_cam_rig[1].inverse()).norm(), 1e-14);
}

TEST(RosFormat, WithoutRectificationRIsTheIdentityAndPIsK) {
  const std::string text = bytes_of(written("ros", stereo()), "right.yaml");
  EXPECT_THAT(text,
              HasSubstr("rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]"));
  EXPECT_THAT(text, HasSubstr("data: [536, 0, 327, 0, 0, 537, 249, 0, 0, 0, 1, 0]"));
  EXPECT_THAT(text, HasSubstr("distortion_model: plumb_bob"));
}

TEST(RosFormat, ARectifiedSizeOfItsOwnIsRefused) {
  StereoRectification r = rectification();
  r.size = {800, 600};
  WriteOptions options;
  options.rectification = &r;
  EXPECT_THAT(find_format("ros")->write(stereo(), options).error().text(), HasSubstr("640x480 and 800x600"));
}

TEST(RosFormat, ReadsWhatCameraCalibrationWrites) {
  const std::string text =
      "image_width: 640\nimage_height: 480\ncamera_name: head_camera\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
      "  data: [438.783367, 0.000000, 305.593336, 0.000000, 437.302876, 243.738352, 0.000000, 0.000000, "
      "1.000000]\n"
      "distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n"
      "  data: [-0.361976, 0.110510, 0.001014, 0.000505, 0.000000]\nrectification_matrix:\n  rows: 3\n  "
      "cols: 3\n"
      "  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nprojection_matrix:\n  rows: 3\n  cols: 4\n  data: [393.65, 0, "
      "322.79, 0, 0, 241.8, 241.8, 0, 0, 0, 1, 0]\n";
  const auto rig = read_rig(std::vector<NamedBytes>{{"ost.yaml", text}});
  ASSERT_TRUE(rig) << rig.error().text();
  EXPECT_EQ(rig->cameras[0].name, "head_camera");
  EXPECT_EQ(params(rig->cameras[0].lens)[4], -0.361976);
  EXPECT_EQ(params(rig->cameras[0].lens)[6], 0.001014);
  std::string uncalibrated = text;
  uncalibrated.replace(uncalibrated.find("438.783367"), 10, "0");
  EXPECT_THAT(read_rig(std::vector<NamedBytes>{{"ost.yaml", uncalibrated}}).error().text(),
              HasSubstr("never calibrated"));
}

TEST(RosFormat, AThirdCameraThatWasNotRectifiedLeavesThePosesUnknown) {
  Rig rig = rectified_pair();
  rig.cameras.push_back(camera_of("third", "pinhole", {500, 500, 320, 240}));
  rig.T_cam_rig.push_back(SE3(Mat3::Identity(), {0, 0.2, 0}));
  const StereoRectification r = rectification();
  WriteOptions options;
  options.rectification = &r;
  const auto back = read_rig(written("ros", rig, options));
  ASSERT_TRUE(back) << back.error().text();
  EXPECT_FALSE(poses_known(*back));
  EXPECT_EQ(back->T_cam_rig[1], SE3());
}

class RosLens : public ::testing::TestWithParam<std::string> {};

// ROS's own parser must see our numbers.
TEST_P(RosLens, RosOwnParserReadsOurFile) {
  const TempDir dir;
  const std::string name = GetParam();
  const Lens names = make_lens(name, {640, 480}, 500).value();
  std::vector<double> values;
  for (int i = 0; i < n_params(names); ++i) values.push_back(i < 4 ? 500 + i : 0.01 * (i + 1) / 3);
  Rig rig;
  rig.cameras = {camera_of("left", name, values)};
  rig.T_cam_rig = {SE3()};
  StereoRectification r = rectification();
  WriteOptions options;
  options.rectification = &r;
  test::write_text(dir / "left.yaml", bytes_of(written("ros", rig, options), "left.yaml"));
  const auto run = test::run(
      "/usr/bin/python3 -c \"import camera_calibration_parsers as c\n"
      "n, i = c.readCalibration('" +
      (dir / "left.yaml").string() +
      "')\n"
      "print(n, i.width, i.height, i.distortion_model, len(i.D))\n"
      "for v in (list(i.K) + list(i.D) + list(i.R) + list(i.P)): print(repr(v))\"");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  std::istringstream out(run.out);
  std::string camera, model;
  int width = 0, height = 0, n_d = 0;
  out >> camera >> width >> height >> model >> n_d;
  EXPECT_EQ(camera, "left");
  EXPECT_EQ(width, 640);
  EXPECT_EQ(height, 480);
  EXPECT_EQ(model, name == "kb4" ? "equidistant" : name == "opencv8" ? "rational_polynomial" : "plumb_bob");
  std::vector<double> expected{500, 0, 502, 0, 501, 503, 0, 0, 1};
  expected.insert(expected.end(), values.begin() + 4, values.end());
  if (name == "pinhole" || name == "opencv4") expected.resize(9 + 5, 0.0);
  EXPECT_EQ(n_d, static_cast<int>(expected.size()) - 9);
  for (int k = 0; k < 9; ++k) expected.push_back(r.R_rect_cam[0](k / 3, k % 3));
  for (int k = 0; k < 12; ++k) expected.push_back(r.P[0](k / 4, k % 4));
  for (double want : expected) {
    double got = NAN;
    out >> got;
    EXPECT_EQ(got, want);
  }
}
INSTANTIATE_TEST_SUITE_P(All, RosLens, ::testing::Values("pinhole", "opencv4", "opencv5", "opencv8", "kb4"));

// --- Kalibr ---

/// The numbers in brackets that follow `key`.
std::vector<double> numbers_after(const std::string& text, const std::string& key, std::size_t n) {
  std::string rest = text.substr(text.find(key) + key.size());
  rest.erase(0, rest.find('['));
  for (char& c : rest) c = c == '[' || c == ']' || c == ',' ? ' ' : c;
  for (auto at = rest.find("\n  - "); at != std::string::npos; at = rest.find("\n  - ")) rest[at + 3] = ' ';
  std::istringstream in(rest);
  std::vector<double> values(n, NAN);
  for (double& value : values) in >> value;
  return values;
}

// By hand, because a matrix that is transposed on the way out and on the way in comes back unharmed: a turn
// by 20 degrees about y is [c 0 s; 0 1 0; -s 0 c], row by row.
TEST(WriteFormats, RotationsAreWrittenRowByRowFromTheFirstCameraToTheSecond) {
  Rig rig = stereo("opencv4", {-0.28, 0.025, 0.0012, -0.00013});
  const double angle = 20 * M_PI / 180, c = 0.93969262078590838, s = 0.34202014332566873;
  rig.T_cam_rig[1] = SE3(so3_exp({0, angle, 0}), {-0.1, 0.05, 0.02});
  const auto expect_near = [](const std::vector<double>& got, const std::vector<double>& want) {
    ASSERT_EQ(got.size(), want.size());
    for (std::size_t i = 0; i < want.size(); ++i) EXPECT_NEAR(got[i], want[i], 1e-15) << i;
  };
  const std::string opencv = bytes_of(written("opencv", rig), "extrinsics.yml");
  expect_near(numbers_after(opencv, "\nR: ", 9), {c, 0, s, 0, 1, 0, -s, 0, c});
  expect_near(numbers_after(opencv, "\nT: ", 3), {-0.1, 0.05, 0.02});
  expect_near(numbers_after(written("kalibr", rig)[0].bytes, "T_cn_cnm1:", 12),
              {c, 0, s, -0.1, 0, 1, 0, 0.05, -s, 0, c, 0.02});
  expect_near(numbers_after(written("mrcal", rig)[1].bytes, "'rt_cam_ref':", 6),
              {0, angle, 0, -0.1, 0.05, 0.02});
}

const char* const kKalibrOwn =
    "cam0:\n  cam_overlaps: [1]\n  camera_model: pinhole\n  distortion_coeffs: [-0.3, 0.1, 0.001, -0.002]\n  "
    "distortion_model: radtan\n"
    "  intrinsics: [461.5, 460.2, 362.6, 248.1]\n  resolution: [752, 480]\n  rostopic: /cam0/image_raw\n"
    "cam1:\n  T_cn_cnm1:\n  - [1.0, 0.0, 0.0, -0.11]\n  - [0.0, 1.0, 0.0, 0.001]\n  - [0.0, 0.0, 1.0, "
    "0.002]\n  - [0.0, 0.0, 0.0, 1.0]\n"
    "  cam_overlaps: [0]\n  camera_model: pinhole\n  distortion_coeffs: [0.01, 0.02, -0.03, 0.004]\n  "
    "distortion_model: equidistant\n"
    "  intrinsics: [460.5, 459.2, 379.6, 255.1]\n  resolution: [752, 480]\n  rostopic: "
    "/camera/infra2/image_raw\n";

TEST(KalibrFormat, ReadsKalibrsOwnFile) {
  const auto rig = read_rig(std::vector<NamedBytes>{{"camchain.yaml", kKalibrOwn}});
  ASSERT_TRUE(rig) << rig.error().text();
  EXPECT_EQ(rig->cameras[0].name, "cam0");
  EXPECT_EQ(rig->cameras[1].name, "infra2");
  EXPECT_EQ(lens_name(rig->cameras[0].lens), "opencv4");
  EXPECT_EQ(lens_name(rig->cameras[1].lens), "kb4");
  EXPECT_EQ(rig->cameras[0].size, (ImageSize{752, 480}));
  EXPECT_EQ(params(rig->cameras[0].lens)[1], 460.2);
  EXPECT_EQ(params(rig->cameras[0].lens)[7], -0.002);
  EXPECT_EQ(rig->T_cam_rig[1], SE3(Mat3::Identity(), {-0.11, 0.001, 0.002}));
}

TEST(KalibrFormat, TheChainIsEachCameraFromTheOneBefore) {
  Rig rig = stereo("opencv4", {-0.28, 0.025, 0.0012, -0.00013});
  rig.cameras.push_back(camera_of("third", "pinhole", {500, 500, 320, 240}));
  rig.T_cam_rig = {SE3(), SE3(Mat3::Identity(), {-0.1, 0, 0}), SE3(Mat3::Identity(), {-0.3, 0, 0.05})};
  const auto files = written("kalibr", rig);
  EXPECT_THAT(files[0].bytes, HasSubstr("cam2:\n  cam_overlaps: [0, 1]\n"));
  const auto at = files[0].bytes.find("T_cn_cnm1", files[0].bytes.find("cam2:"));
  EXPECT_THAT(files[0].bytes.substr(at, 60), HasSubstr("- [1, 0, 0, -0.1"));  // -0.3 + 0.1, not -0.3
  EXPECT_THAT(files[0].bytes, HasSubstr("distortion_coeffs: []\n  distortion_model: none"));
}

TEST(KalibrFormat, PosesThroughTheImuAreRead) {
  std::string text = kKalibrOwn;
  text.replace(text.find("T_cn_cnm1"), 9, "T_cam_imu");
  EXPECT_THAT(read_rig(std::vector<NamedBytes>{{"c", text}}).error().text(),
              HasSubstr("where does this camera stand?"));
  text.insert(text.find("  cam_overlaps: [1]"),
              "  T_cam_imu:\n  - [0.0, -1.0, 0.0, 0.5]\n  - [1.0, 0.0, 0.0, 0.0]\n  - [0.0, 0.0, 1.0, 0.0]\n "
              " - [0.0, 0.0, 0.0, 1.0]\n");
  const auto rig = read_rig(std::vector<NamedBytes>{{"c", text}});
  ASSERT_TRUE(rig) << rig.error().text();
  // p_imu = T_cam0_imu^-1 p_cam0: the origin of cam0 is at (0, 0.5, 0) in the imu frame.
  EXPECT_NEAR((rig->T_cam_rig[1].t() - Vec3(-0.11, 0.501, 0.002)).norm(), 0, 1e-15);
}

TEST(KalibrFormat, OtherModelsAreNamed) {
  std::string text = kKalibrOwn;
  text.replace(text.find("pinhole"), 7, "ocam");
  EXPECT_THAT(read_rig(std::vector<NamedBytes>{{"c", text}}).error().text(),
              HasSubstr("cam0.camera_model, line 3: camera model 'ocam'"));
  const auto unsupported = find_format("kalibr")->write(stereo(), {});
  ASSERT_FALSE(unsupported);
  EXPECT_EQ(unsupported.error().text(),
            "camera left: format kalibr cannot express the lens opencv5 with these values (it knows: pinhole "
            "opencv4 kb4 ucm mei eucm ds fov); calibrate "
            "with one of those, or write one of: plumbline, opencv, ros, mrcal, colmap [kUnsupported]");
  // A third radial term of zero is an opencv4 in all but name.
  EXPECT_TRUE(find_format("kalibr")->write(stereo("opencv5", {-0.28, 0.025, 0.0012, -0.00013, 0}), {}));
  // Kalibr keeps alpha to 0 to 1.
  EXPECT_TRUE(find_format("kalibr")->write(stereo("eucm", {0.6, 1.1}), {}));
  EXPECT_FALSE(find_format("kalibr")->write(stereo("eucm", {-0.01, 1.1}), {}));
}

// --- COLMAP ---

TEST(ColmapFormat, TheTopLeftPixelsCentreIsHalfAPixelFromTheOrigin) {
  Rig rig = stereo("opencv4", {-0.28, 0.025, 0.5, 0.25});
  rig.cameras.push_back(camera_of("c", "opencv5", {500, 501, 320, 240, 1, 2, 3, 4, 5}));
  rig.cameras.push_back(camera_of("d", "kb4", {500, 501, 320, 240, 1, 2, 3, 4}));
  rig.T_cam_rig.resize(4);
  EXPECT_EQ(written("colmap", rig)[0].bytes,
            "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: 4\n"
            "1 OPENCV 640 480 533 534 342.5 234.5 -0.28000000000000003 0.025000000000000001 0.5 0.25\n"
            "2 OPENCV 640 480 536 537 327.5 249.5 -0.28000000000000003 0.025000000000000001 0.5 0.25\n"
            "3 FULL_OPENCV 640 480 500 501 320.5 240.5 1 2 3 4 5 0 0 0\n"
            "4 OPENCV_FISHEYE 640 480 500 501 320.5 240.5 1 2 3 4\n");
}

TEST(ColmapFormat, ReadsTheSimplerModels) {
  const auto rig =
      read_rig(std::vector<NamedBytes>{{"cameras.txt",
                                        "# Camera list with one line of data per camera:\n#   CAMERA_ID, "
                                        "MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: 2\n"
                                        "1 SIMPLE_RADIAL 3072 2304 2559.81 1536 1152 -0.0204997\n7 PINHOLE "
                                        "3072 2304 2560.56 2561 1536 1152\n"}});
  ASSERT_TRUE(rig) << rig.error().text();
  ASSERT_EQ(rig->cameras.size(), 2u);
  EXPECT_EQ(lens_name(rig->cameras[0].lens), "opencv4");
  EXPECT_EQ(params(rig->cameras[0].lens)[1], 2559.81);
  EXPECT_EQ(params(rig->cameras[0].lens)[2], 1535.5);
  EXPECT_EQ(params(rig->cameras[0].lens)[4], -0.0204997);
  EXPECT_EQ(rig->cameras[1].name, "camera7");
  const auto error_of = [](const std::string& line) {
    return read_rig(std::vector<NamedBytes>{{"c", "1 PINHOLE 9 9 1 1 1 1\n" + line + "\n"}}).error().text();
  };
  EXPECT_THAT(error_of("2 THIN_PRISM_FISHEYE 9 9 1 1 1 1 1"),
              HasSubstr("c: line 2: camera model 'THIN_PRISM_FISHEYE'"));
  EXPECT_THAT(error_of("2 PINHOLE 9 9 1 1 1"), HasSubstr("PINHOLE has 4 parameters, there are 3"));
  EXPECT_THAT(error_of("2 PINHOLE 9 9 1 1 1 nan"), HasSubstr("'nan'"));
}

// --- the door for all ---

TEST(ReadRig, TellsTheFormatFromTheContentAndRefusesMixtures) {
  const auto error_of = [](std::vector<NamedBytes> files, const char* name = "") {
    return read_rig(files, name).error().text();
  };
  EXPECT_THAT(error_of({}), HasSubstr("no camera file"));
  EXPECT_THAT(error_of({{"a", "hello\n"}}), HasSubstr("a: not a camera file"));
  EXPECT_THAT(error_of({{"a", kOpencvOwn}}, "nonsense"), HasSubstr("known are: plumbline, opencv"));
  EXPECT_THAT(error_of({{"a", kOpencvOwn}, {"b", kKalibrOwn}}),
              HasSubstr("b: this file is of format kalibr"));
  EXPECT_THAT(error_of({{"a", kOpencvOwn}}, "kalibr"), HasSubstr("no 'cam0'"));
  EXPECT_THAT(error_of({{"a", kKalibrOwn}, {"b", kKalibrOwn}}), HasSubstr("give one"));
}

TEST(ReadRig, FilesWithoutPosesGiveCamerasWhosePosesAreNotKnown) {
  const Rig rig = stereo();
  EXPECT_TRUE(poses_known(rig));
  EXPECT_TRUE(poses_known(*read_rig(written("opencv", rig))));
  EXPECT_TRUE(poses_known(*read_rig(std::vector<NamedBytes>{{"a.yml", kOpencvOwn}})));  // one camera
  for (const std::vector<NamedBytes>& files :
       {std::vector<NamedBytes>{written("opencv", rig)[0]}, written("colmap", rig), written("ros", rig),
        std::vector<NamedBytes>{{"a.yml", kOpencvOwn}, {"b.yml", kOpencvOwn}}}) {
    const auto back = read_rig(files);
    ASSERT_TRUE(back) << back.error().text();
    ASSERT_EQ(back->cameras.size(), 2u);
    EXPECT_FALSE(poses_known(*back)) << files[0].name;
    EXPECT_EQ(back->T_cam_rig[1], SE3());
    for (const Format* format : formats()) {
      const auto again = format->write(*back, {});
      const std::string_view name = format->name;
      const bool needs_poses = name == "opencv" || name == "kalibr" || name == "mrcal";
      EXPECT_EQ(!again, needs_poses) << name;
      if (again) EXPECT_FALSE(poses_known(*read_rig(*again))) << name;
      if (again || name == "kalibr") continue;  // kalibr does not know opencv5, and says that first
      EXPECT_EQ(again.error().code, ErrorCode::kUnsupported);
      EXPECT_THAT(again.error().text(), HasSubstr("the poses of the cameras are not known"));
    }
  }
  Rig radtan = stereo("opencv4", {-0.28, 0.025, 0.0012, -0.00013});
  EXPECT_TRUE(find_format("kalibr")->write(radtan, {}));
  radtan.T_cam_rig[1] = radtan.T_cam_rig[0];
  EXPECT_THAT(find_format("kalibr")->write(radtan, {}).error().text(),
              HasSubstr("the poses of the cameras are not known"));
}

TEST(OpencvFormat, ThreeCamerasWithoutPosesAreWrittenWithoutPoses) {
  Rig rig = stereo();
  rig.cameras.push_back(camera_of("third", "pinhole", {500, 500, 320, 240}));
  rig.T_cam_rig.assign(3, SE3());
  const auto files = written("opencv", rig);
  for (const NamedBytes& file : files) EXPECT_EQ(file.bytes.find("T_cam_rig"), std::string::npos);
  EXPECT_FALSE(poses_known(*read_rig(files)));
  rig.T_cam_rig = {SE3(), SE3(Mat3::Identity(), {-0.1, 0, 0}), SE3(Mat3::Identity(), {-0.2, 0, 0})};
  auto mixed = written("opencv", rig);
  mixed[1] = files[1];
  EXPECT_THAT(read_rig(mixed).error().text(), HasSubstr("some cameras have a pose"));
}

TEST(ReadRig, NamesAreMadeDistinct) {
  const auto model = written("mrcal", stereo())[0].bytes;
  const auto rig =
      read_rig(std::vector<NamedBytes>{{"a/cam.cameramodel", model}, {"b/cam.cameramodel", model}});
  EXPECT_EQ(rig->cameras[0].name, "cam");
  EXPECT_EQ(rig->cameras[1].name, "cam_2");
}

TEST(WriteFormats, NamesThatNoFileCanHaveAreReplaced) {
  Rig rig = stereo();
  rig.cameras[0].name = "../a b";
  rig.cameras[1].name = "../a_b";
  const auto files = written("ros", rig);
  EXPECT_EQ(files[0].name, "camera.._a_b.yaml");
  EXPECT_EQ(files[1].name, "camera.._a_b_2.yaml");
  EXPECT_EQ(read_rig(files)->cameras[0].name, "../a b");
}

}  // namespace
}  // namespace plumbline
