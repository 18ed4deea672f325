// SPDX-License-Identifier: Apache-2.0
// The exported files in the hands of those they are for: cv::FileStorage and OpenCV's projection, and mrcal
// through its Python module and its C library. (ROS's parser: formats_test.cpp.)
#include <gmock/gmock.h>

#include <filesystem>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <sstream>

extern "C" {
#include <mrcal/mrcal.h>
}

#include "plumbline/geometry/so3.hpp"
#include "plumbline/io/formats.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
namespace fs = std::filesystem;
using test::TempDir;
using ::testing::HasSubstr;

Lens full_lens(const std::string& name, double focal) {
  Lens lens = make_lens(name, {640, 480}, focal).value();
  const auto values = params(lens);
  for (std::size_t i = 1; i < values.size(); ++i)
    values[i] += i < 4 ? 1.25 * static_cast<double>(i) : (i % 2 ? -0.03 : 0.04) / static_cast<double>(i);
  return lens;
}

Rig pair_of(const std::string& lens) {
  Rig rig;
  rig.cameras = {{"left", {640, 480}, full_lens(lens, 400)}, {"right", {640, 480}, full_lens(lens, 420)}};
  rig.T_cam_rig = {SE3(), SE3(so3_exp({0.02, -0.2, 0.05}), {-0.12, 0.013, 1.0 / 300})};
  return rig;
}

const std::vector<Vec3>& points() {
  static const std::vector<Vec3> all{
      {0, 0, 1}, {0.3, -0.2, 1.1}, {-0.4, 0.3, 0.9}, {0.5, 0.4, 1.3}, {-0.2, -0.35, 0.8}};
  return all;
}

std::map<std::string, fs::path> written(const TempDir& dir, const std::string& format, const Rig& rig,
                                        const WriteOptions& options = {}) {
  std::map<std::string, fs::path> files;
  const std::vector<NamedBytes> all = find_format(format)->write(rig, options).value();
  for (const NamedBytes& file : all) {
    test::write_text(dir / file.name, file.bytes);
    files[file.name] = dir / file.name;
  }
  return files;
}

/// Largest distance between OpenCV's pixels with these matrices and ours; p_cam = T p.
double opencv_difference_px(const cv::Mat& K, const cv::Mat& D, bool fisheye, const Lens& lens,
                            const SE3& T) {
  double worst = 0;
  for (const Vec3& p : points()) {
    const Vec3 p_cam = T * p;
    const std::vector<cv::Point3d> object{{p_cam.x(), p_cam.y(), p_cam.z()}};
    std::vector<cv::Point2d> px;
    const cv::Vec3d zero(0, 0, 0);
    if (fisheye)
      cv::fisheye::projectPoints(object, px, zero, zero, K, D);
    else
      cv::projectPoints(object, zero, zero, K, D, px);
    worst = std::max(worst, (Vec2(px[0].x, px[0].y) - project(lens, p_cam).value()).norm());
  }
  return worst;
}

class OpencvLoads : public ::testing::TestWithParam<std::string> {};

TEST_P(OpencvLoads, OneCamera) {
  const TempDir dir;
  Rig rig = pair_of(GetParam());
  rig.cameras.pop_back();
  rig.T_cam_rig.pop_back();
  WriteOptions options;
  options.rms_px = 0.125;
  const auto files = written(dir, "opencv", rig, options);
  const cv::FileStorage in(files.at("left.yml"), cv::FileStorage::READ);
  ASSERT_TRUE(in.isOpened());
  cv::Mat K, D;
  in["camera_matrix"] >> K;
  in["distortion_coefficients"] >> D;
  EXPECT_EQ(static_cast<int>(in["image_width"]), 640);
  EXPECT_EQ(static_cast<int>(in["image_height"]), 480);
  EXPECT_EQ(static_cast<double>(in["avg_reprojection_error"]), 0.125);
  EXPECT_EQ(static_cast<std::string>(in["camera_name"]), "left");
  const bool fisheye = static_cast<int>(in["fisheye_model"]) == 1;
  EXPECT_EQ(fisheye, GetParam() == "kb4");
  EXPECT_LT(opencv_difference_px(K, D, fisheye, rig.cameras[0].lens, SE3()), 1e-9);
}

TEST_P(OpencvLoads, APairWithItsRectification) {
  const TempDir dir;
  const Rig rig = pair_of(GetParam());
  StereoRectification r;
  r.size = {640, 480};
  r.R_rect_cam = {so3_exp({0.1, 0, 0}), so3_exp({0, 0.1, 0})};
  r.P[0] << 500, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0;
  r.P[1] = r.P[0];
  r.P[1](0, 3) = -62.5;
  r.Q << 1, 0, 0, -320, 0, 1, 0, -240, 0, 0, 0, 500, 0, 0, 8, 0;
  WriteOptions options;
  options.rectification = &r;
  const auto files = written(dir, "opencv", rig, options);
  const cv::FileStorage in(files.at("intrinsics.yml"), cv::FileStorage::READ),
      ex(files.at("extrinsics.yml"), cv::FileStorage::READ);
  ASSERT_TRUE(in.isOpened() && ex.isOpened());
  cv::Mat M1, D1, M2, D2, R, T, R1, R2, P1, P2, Q;
  in["M1"] >> M1, in["D1"] >> D1, in["M2"] >> M2, in["D2"] >> D2;
  ex["R"] >> R, ex["T"] >> T, ex["R1"] >> R1, ex["R2"] >> R2, ex["P1"] >> P1, ex["P2"] >> P2, ex["Q"] >> Q;
  const bool fisheye = static_cast<int>(in["fisheye_model"]) == 1;
  EXPECT_LT(opencv_difference_px(M1, D1, fisheye, rig.cameras[0].lens, SE3()), 1e-9);
  EXPECT_LT(opencv_difference_px(M2, D2, fisheye, rig.cameras[1].lens, rig.T_cam_rig[1]), 1e-9);
  // x2 = R x1 + T
  const Vec3 p1 = points()[1], p2 = rig.T_cam_rig[1] * p1;
  const cv::Mat x2 = R * (cv::Mat_<double>(3, 1) << p1.x(), p1.y(), p1.z()) + T;
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(x2.at<double>(i), p2[i], 1e-15);
  EXPECT_EQ(R2.at<double>(0, 2), r.R_rect_cam[1](0, 2));
  EXPECT_EQ(R1.at<double>(1, 2), r.R_rect_cam[0](1, 2));
  EXPECT_EQ(P1.size(), cv::Size(4, 3));
  EXPECT_EQ(P2.at<double>(0, 3), -62.5);
  EXPECT_EQ(Q.at<double>(3, 2), 8);
  if (fisheye) return;
  // Undistorted pixels of one point satisfy x2' F x1 = 0.
  cv::Mat F, E;
  ex["F"] >> F, ex["E"] >> E;
  const cv::Mat q1 = M1 * (cv::Mat_<double>(3, 1) << p1.x() / p1.z(), p1.y() / p1.z(), 1);
  const cv::Mat q2 = M2 * (cv::Mat_<double>(3, 1) << p2.x() / p2.z(), p2.y() / p2.z(), 1);
  const cv::Mat line = F * q1;
  EXPECT_NEAR(q2.dot(line) / std::hypot(line.at<double>(0), line.at<double>(1)), 0, 1e-9);
  EXPECT_NEAR(cv::norm(E), std::sqrt(2.0) * rig.T_cam_rig[1].t().norm(), 1e-12);
}
INSTANTIATE_TEST_SUITE_P(All, OpencvLoads,
                         ::testing::Values("pinhole", "opencv4", "opencv5", "opencv8", "opencv12", "kb4"));

TEST(OpencvLoads, WhatOpencvWritesIsRead) {
  const TempDir dir;
  const cv::Mat K = (cv::Mat_<double>(3, 3) << 500.1, 0, 320.2, 0, 501.3, 240.4, 0, 0, 1);
  const cv::Mat D = (cv::Mat_<double>(1, 5) << -0.1, 1.0 / 3, 1e-300, -0.0, 5);
  const cv::Mat R = cv::Mat::eye(3, 3, CV_64F), T = (cv::Mat_<double>(3, 1) << -1, 2, 3);
  {
    cv::FileStorage out(dir / "intrinsics.yml", cv::FileStorage::WRITE);
    out << "image_width" << 640 << "image_height" << 480 << "M1" << K << "D1" << D << "M2" << K << "D2" << D;
    cv::FileStorage poses(dir / "extrinsics.yml", cv::FileStorage::WRITE);
    poses << "R" << R << "T" << T;
  }
  const auto rig =
      read_rig(std::vector<NamedBytes>{{"intrinsics.yml", test::read_text(dir / "intrinsics.yml")},
                                       {"extrinsics.yml", test::read_text(dir / "extrinsics.yml")}});
  ASSERT_TRUE(rig) << rig.error().text();
  EXPECT_EQ(rig->T_cam_rig[1].t(), Vec3(-1, 2, 3));
  EXPECT_EQ(params(rig->cameras[1].lens)[5], 1.0 / 3);
  EXPECT_LT(opencv_difference_px(K, D, false, rig->cameras[1].lens, SE3()), 1e-9);
}

class MrcalLoads : public ::testing::TestWithParam<std::string> {};

TEST_P(MrcalLoads, ItsCLibrary) {
  const TempDir dir;
  const Rig rig = pair_of(GetParam());
  const auto files = written(dir, "mrcal", rig);
  for (int i = 0; i < 2; ++i) {
    mrcal_cameramodel_t* model =
        mrcal_read_cameramodel_file(files.at(rig.cameras[i].name + ".cameramodel").c_str());
    ASSERT_NE(model, nullptr);
    EXPECT_EQ(model->imagersize[0], 640u);
    EXPECT_EQ(model->imagersize[1], 480u);
    for (const Vec3& p : points()) {
      double rt[6], at[3] = {p.x(), p.y(), p.z()}, moved[3];
      std::copy(model->rt_cam_ref, model->rt_cam_ref + 6, rt);
      mrcal_transform_point_rt_full(moved, 0, nullptr, 0, 0, nullptr, 0, 0, rt, 0, at, 0, false);
      const mrcal_point3_t p_cam{{.x = moved[0], .y = moved[1], .z = moved[2]}};
      mrcal_point2_t px;
      ASSERT_TRUE(mrcal_project(&px, nullptr, nullptr, &p_cam, 1, &model->lensmodel, model->intrinsics));
      EXPECT_LT((Vec2(px.x, px.y) - project(rig.cameras[i].lens, rig.T_cam_rig[i] * p).value()).norm(), 1e-9);
    }
    mrcal_free_cameramodel(&model);
  }
}

TEST_P(MrcalLoads, ItsPythonModule) {
  const TempDir dir;
  const Rig rig = pair_of(GetParam());
  const auto files = written(dir, "mrcal", rig);
  const auto run = test::run(
      "/usr/bin/python3 -c \"import mrcal, numpy as np\n"
      "m = mrcal.cameramodel('" +
      files.at("right.cameramodel").string() +
      "')\n"
      "p = mrcal.transform_point_rt(m.extrinsics_rt_fromref(), np.array([0.3, -0.2, 1.1]))\n"
      "q = mrcal.project(p, *m.intrinsics())\n"
      "print(m.intrinsics()[0], *[repr(float(v)) for v in q], *m.imagersize())\"");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  std::istringstream out(run.out);
  std::string model;
  double x = 0, y = 0;
  int width = 0, height = 0;
  out >> model >> x >> y >> width >> height;
  std::string upper = GetParam();
  for (char& c : upper) c = static_cast<char>(std::toupper(c));
  EXPECT_EQ(model, "LENSMODEL_" + upper);
  EXPECT_LT((Vec2(x, y) - project(rig.cameras[1].lens, rig.T_cam_rig[1] * points()[1]).value()).norm(), 1e-9);
  EXPECT_EQ(width, 640);
  EXPECT_EQ(height, 480);
}
INSTANTIATE_TEST_SUITE_P(All, MrcalLoads,
                         ::testing::Values("pinhole", "opencv4", "opencv5", "opencv8", "opencv12"));

// A file as mrcal 2.2 writes it, shortened: comments, trailing commas, a bytes string that holds brackets and
// quotes.
const char* const kMrcalOwn =
    "# generated on 2024-01-01 with   mrcal-calibrate-cameras ... 'left*.jpg'\n# Noutliers: 0 out of 1404 "
    "total points: 0.0% of the data\n"
    "{\n    'lensmodel':  'LENSMODEL_OPENCV5',\n\n    # intrinsics are "
    "fx,fy,cx,cy,distortion0,distortion1,....\n"
    "    'intrinsics': [ 537.4133038, 537.0646577, 327.0572927, 249.9405371, -0.298879327, 0.1545763674, "
    "-0.0005035633709, 9.714414608e-05, -0.0707492742,],\n\n"
    "    'valid_intrinsics_region': [\n    [ 242, 68 ],\n    [ 220, 391 ],\n    [ 520, 400 ],\n    [ 242, 68 "
    "],\n],\n"
    "    # extrinsics are rt_fromref\n    'extrinsics': [ 0.007154872907, 0.004783233508, -0.003506420939, "
    "-0.0831611262, 0.0009202139772, -3.190330471e-05,],\n\n"
    "    'imagersize': [ 640, 480,],\n    'icam_intrinsics': 1,\n    'optimization_inputs': "
    "b'P)h>@6{[\"\\'#;',\n}\n";

TEST(MrcalFormat, ReadsMrcalsOwnFile) {
  const auto rig = read_rig(std::vector<NamedBytes>{{"camera-1.cameramodel", kMrcalOwn}});
  ASSERT_TRUE(rig) << rig.error().text();
  EXPECT_EQ(rig->cameras[0].name, "camera-1");
  EXPECT_EQ(lens_name(rig->cameras[0].lens), "opencv5");
  EXPECT_EQ(params(rig->cameras[0].lens)[8], -0.0707492742);
  EXPECT_EQ(rig->T_cam_rig[0], SE3());  // one camera is its own rig
}

TEST(MrcalFormat, TwoFilesAreARigRelativeToTheFirst) {
  const TempDir dir;
  const Rig rig = pair_of("opencv5");
  auto files = find_format("mrcal")->write(rig, {}).value();
  std::swap(files[0], files[1]);
  const auto back = read_rig(files);
  ASSERT_TRUE(back);
  EXPECT_LT(box_minus(back->T_cam_rig[1], rig.T_cam_rig[1].inverse()).norm(), 1e-14);
  std::string other = kMrcalOwn;
  other.replace(other.find("LENSMODEL_OPENCV5"), 17, "LENSMODEL_CAHVOR");
  const auto refused = read_rig(std::vector<NamedBytes>{{"a", other}});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kUnsupported);
  EXPECT_THAT(refused.error().text(), ::testing::HasSubstr("mrcal-convert-lensmodel"));
}

// Real files that mrcal wrote: the same pixels as its C library gets from them.
TEST(MrcalFormat, TheDataSetsModelsProjectAsInMrcal) {
  const auto dir = test::data_dir("mrcal_data");
  PLUMBLINE_NEEDS(dir);
  for (const char* name :
       {"test/data/cam0.opencv8.cameramodel", "test/data/cam1.opencv8.cameramodel",
        "test/data/cam0.splined.cameramodel", "doc/data/figueroa-overpass-looking-S/splined-0.cameramodel"}) {
    const fs::path file = *dir / name;
    const auto rig = read_rig(std::vector<NamedBytes>{{name, test::read_text(file)}});
    ASSERT_TRUE(rig) << rig.error().text();
    mrcal_cameramodel_t* model = mrcal_read_cameramodel_file(file.c_str());
    ASSERT_NE(model, nullptr);
    for (const Vec3& p : points()) {
      const mrcal_point3_t p_cam{{.x = p.x(), .y = p.y(), .z = p.z()}};
      mrcal_point2_t px;
      ASSERT_TRUE(mrcal_project(&px, nullptr, nullptr, &p_cam, 1, &model->lensmodel, model->intrinsics));
      EXPECT_LT((Vec2(px.x, px.y) - project(rig->cameras[0].lens, p).value()).norm(), 1e-9);
    }
    mrcal_free_cameramodel(&model);
    // There and back without a lost bit.
    const auto again = read_rig(find_format("mrcal")->write(*rig, {}).value());
    ASSERT_TRUE(again) << again.error().text();
    EXPECT_EQ(lens_spec(again->cameras[0].lens), lens_spec(rig->cameras[0].lens));
    EXPECT_TRUE(std::ranges::equal(params(again->cameras[0].lens), params(rig->cameras[0].lens)));
  }
}

TEST(MrcalFormat, SplinedLensesOfBothOrdersAreMrcals) {
  const TempDir dir;
  for (const char* spec : {"splined:12x9:120", "splined:9x12:120:2"}) {
    Rig rig;
    Lens lens = make_lens(spec, {640, 480}, 300).value();
    double k = 0;
    for (double& c : params(lens).subspan(4)) c = 1e-3 * std::sin(k += 1);
    rig.cameras = {{"left", {640, 480}, lens}};
    rig.T_cam_rig = {SE3()};
    const auto files = written(dir, "mrcal", rig);
    mrcal_cameramodel_t* model = mrcal_read_cameramodel_file(files.at("left.cameramodel").c_str());
    ASSERT_NE(model, nullptr);
    for (const Vec3& p : points()) {
      const mrcal_point3_t p_cam{{.x = p.x(), .y = p.y(), .z = p.z()}};
      mrcal_point2_t px;
      ASSERT_TRUE(mrcal_project(&px, nullptr, nullptr, &p_cam, 1, &model->lensmodel, model->intrinsics));
      EXPECT_LT((Vec2(px.x, px.y) - project(lens, p).value()).norm(), 1e-9);
    }
    mrcal_free_cameramodel(&model);
  }
  const auto error_of = [](const std::string& model) {
    return read_rig(std::vector<NamedBytes>{{"a.cameramodel", "{ 'lensmodel': '" + model +
                                                                  "', 'intrinsics': [1,1,0,0], 'extrinsics': "
                                                                  "[0,0,0,0,0,0], 'imagersize': [9,9] }"}})
        .error()
        .text();
  };
  EXPECT_THAT(error_of("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=30_fov_x_deg=170"),
              HasSubstr("has no Ny="));
  EXPECT_THAT(error_of("LENSMODEL_SPLINED_STEREOGRAPHIC_order=5_Nx=30_Ny=20_fov_x_deg=170"),
              HasSubstr("order 5 is neither 2 nor 3"));
  EXPECT_THAT(error_of("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=20_fov_x_deg=170"),
              HasSubstr("has 1204 parameters, 4 are given"));
}

}  // namespace
}  // namespace plumbline
