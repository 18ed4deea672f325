// SPDX-License-Identifier: Apache-2.0
// The whole road on the real photographs of OpenCV's documentation: images -> calibration -> rectified pairs
// -> files, with OpenCV and mrcal as referees on the same corners.
#include <nlohmann/json.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "plumbline/assess/compare.hpp"
#include "plumbline/io/calibration_io.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
namespace fs = std::filesystem;
using Json = nlohmann::json;

// Calibrated once for all tests of this file: the pair, and the left camera alone.
class Demo : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    const auto images = test::demo_images();
    if (!images) return;
    dir = new test::TempDir;
    test::write_text(*dir / "board.yaml", "type: chessboard\ncorners: [9, 6]\nsquare_m: 0.025\n");
    cams = " --cam 'left=" + (*images / "left*.jpg").string() +
           "' --cam 'right=" + (*images / "right*.jpg").string() + "' ";
    const std::string rest =
        " --target " + (*dir / "board.yaml").string() + " --lens opencv5 --outliers off --json -o ";
    pair = test::plumbline("calibrate" + cams + rest + (*dir / "pair").string());
    for (const char* side : {"left", "right"}) {
      alone[side] = test::plumbline("calibrate --cam '" + std::string(side) + "=" +
                                    (*images / side).string() + "*.jpg'" + rest + (*dir / side).string());
    }
  }
  static void TearDownTestSuite() { delete dir; }
  void SetUp() override {
    PLUMBLINE_NEEDS(test::demo_images());
    ASSERT_EQ(pair.exit_code, 0) << pair.err;
  }

  static Calibration calibration(const std::string& name) {
    return *parse_calibration(test::read_text(*dir / name / "calibration.yaml"));
  }

  // The corners of one camera in OpenCV's form: float, because calibrateCamera takes nothing else.
  static void opencv_corners(const Calibration& c, int cam, std::vector<std::vector<cv::Point3f>>& object,
                             std::vector<std::vector<cv::Point2f>>& image) {
    for (const View& view : c.data.views) {
      if (view.cam != cam || view.corners.empty()) continue;
      object.emplace_back();
      image.emplace_back();
      for (const Corner& corner : view.corners) {
        const Vec3& p = c.data.targets[0].points[corner.point];
        object.back().emplace_back(float(p.x()), float(p.y()), float(p.z()));
        image.back().emplace_back(float(corner.px.x()), float(corner.px.y()));
      }
    }
  }

  static inline test::TempDir* dir = nullptr;
  static inline std::string cams;
  static inline test::Run pair;
  static inline std::map<std::string, test::Run> alone;
};

const cv::TermCriteria kTight(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 300, 1e-15);

TEST_F(Demo, EveryBoardIsFoundAndTheReportKeepsTheContract) {
  const Json report = Json::parse(pair.out);
  for (const char* key : {"rms_px", "rms_xy_px", "cameras", "T_cam_rig", "views", "outliers", "seconds"}) {
    EXPECT_TRUE(report.contains(key)) << key;
  }
  EXPECT_EQ(report["cameras"].size(), 2U);
  EXPECT_EQ(report["views"].size(), 26U);
  for (const Json& view : report["views"]) {
    EXPECT_TRUE(view["used"]) << view;
    EXPECT_EQ(view["corners"], 54) << view;
    EXPECT_TRUE(view["reason"].is_null());
  }
  EXPECT_EQ(report["T_cam_rig"][1]["T"].size(), 16U);
  EXPECT_NEAR(double(report["rms_px"]) / double(report["rms_xy_px"]), std::sqrt(2.0), 1e-12);
  for (const char* name : {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"}) {
    EXPECT_TRUE(report["cameras"][0]["params"].contains(name)) << name;
  }
}

TEST_F(Demo, EachCameraAloneAgreesWithOpenCV) {
  for (const char* side : {"left", "right"}) {
    ASSERT_EQ(alone[side].exit_code, 0) << alone[side].err;
    const Calibration ours = calibration(side);
    std::vector<std::vector<cv::Point3f>> object;
    std::vector<std::vector<cv::Point2f>> image;
    opencv_corners(ours, 0, object, image);
    ASSERT_EQ(object.size(), 13U);
    cv::Mat K, D, rvecs, tvecs;
    const double rms = cv::calibrateCamera(object, image, {640, 480}, K, D, rvecs, tvecs, 0, kTight);
    EXPECT_NEAR(rms, ours.stats.rms_px, 1e-6);
    const double* d = D.ptr<double>();
    const OpenCV5 lens{K.at<double>(0, 0),
                       K.at<double>(1, 1),
                       K.at<double>(0, 2),
                       K.at<double>(1, 2),
                       {d[0], d[1], d[2], d[3], d[4]}};
    const auto diff = compare_cameras(ours.rig.cameras[0], {side, {640, 480}, lens});
    ASSERT_TRUE(diff) << diff.error().text();
    EXPECT_LT(diff->max, 0.01) << side;  // OpenCV takes its points as float: 7e-4 px is what that costs
    EXPECT_EQ(diff->compared_fraction, 1.0);
  }
}

TEST_F(Demo, ThePairAgreesWithOpenCVWithAllParametersFree) {
  const Calibration ours = calibration("pair");
  std::vector<std::vector<cv::Point3f>> object, unused;
  std::vector<std::vector<cv::Point2f>> left, right;
  opencv_corners(ours, 0, object, left);
  opencv_corners(ours, 1, unused, right);
  ASSERT_EQ(left.size(), right.size());
  cv::Mat K1, D1, K2, D2, R, T, E, F, rvecs, tvecs;
  cv::calibrateCamera(object, left, {640, 480}, K1, D1, rvecs, tvecs, 0, kTight);
  cv::calibrateCamera(object, right, {640, 480}, K2, D2, rvecs, tvecs, 0, kTight);
  const double rms = cv::stereoCalibrate(object, left, right, K1, D1, K2, D2, {640, 480}, R, T, E, F,
                                         cv::CALIB_USE_INTRINSIC_GUESS, kTight);
  EXPECT_NEAR(rms, ours.stats.rms_px, 1e-6);
  const SE3& T_right_left = ours.rig.T_cam_rig[1];
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(T.at<double>(i), T_right_left.t()[i], 1e-7);
  EXPECT_NEAR(K1.at<double>(0, 0), params(ours.rig.cameras[0].lens)[0], 1e-3);
  EXPECT_NEAR(K2.at<double>(0, 0), params(ours.rig.cameras[1].lens)[0], 1e-3);
}

TEST_F(Demo, MrcalAgrees) {
  const test::Run run =
      test::plumbline("crosscheck --json " + (*dir / "pair/calibration.yaml").string() + " --max-diff 0.01");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const Json report = Json::parse(run.out);
  ASSERT_EQ(report["cameras"].size(), 2U);
  for (const Json& camera : report["cameras"]) {
    EXPECT_LT(double(camera["diff_px"]["max"]), 0.01) << camera;
    EXPECT_NEAR(double(camera["rms_px"]), double(camera["referee_rms_px"]), 1e-5);
  }
  EXPECT_NEAR(double(report["joint"]["rms_px"]), double(report["joint"]["referee_rms_px"]), 1e-4);
  EXPECT_NEAR(double(report["joint"]["rms_px"]), double(Json::parse(pair.out)["rms_px"]), 1e-9);
}

TEST_F(Demo, TheRectifiedRowsMatch) {
  const test::Run run = test::plumbline("rectify --json " + (*dir / "pair/calibration.yaml").string() + cams +
                                        "-o " + (*dir / "rect").string());
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const Json report = Json::parse(run.out);
  EXPECT_LT(double(report["vertical_rms_px"]), 0.3);
  EXPECT_NEAR(double(report["baseline_m"]), 0.0832, 0.0005);
  EXPECT_GT(double(report["fx"]), 0);
  EXPECT_EQ(double(report["valid_fraction"]), 1.0);  // alpha 0: no black border
  for (const char* name : {"left/left01.png", "left/left14.png", "right/right01.png"}) {
    const cv::Mat image = cv::imread((*dir / "rect" / name).string(), cv::IMREAD_UNCHANGED);
    EXPECT_EQ(image.size(), cv::Size(640, 480)) << name;
  }
  cv::FileStorage file((*dir / "rect/rectification.yaml").string(), cv::FileStorage::READ);
  cv::Mat R1, P2, Q;
  file["R1"] >> R1;
  file["P2"] >> P2;
  file["Q"] >> Q;
  EXPECT_EQ(R1.size(), cv::Size(3, 3));
  EXPECT_NEAR(-P2.at<double>(0, 3) / P2.at<double>(0, 0), double(report["baseline_m"]), 1e-12);
  EXPECT_EQ(Q.size(), cv::Size(4, 4));
}

TEST_F(Demo, RectifiedPicturesShowTheBoardOnTheSameRows) {
  // A second derivation: the board found again, by OpenCV, in the pictures that were written.
  ASSERT_EQ(test::plumbline("rectify " + (*dir / "pair/calibration.yaml").string() + cams + "-o " +
                            (*dir / "again").string())
                .exit_code,
            0);
  double sum = 0;
  int n = 0;
  for (const char* frame : {"01", "02", "03", "05", "06", "07", "08", "11", "12", "13"}) {
    std::array<std::vector<cv::Point2f>, 2> corners;
    bool both = true;
    for (int i = 0; i < 2; ++i) {
      const std::string side = i == 0 ? "left" : "right";
      const cv::Mat image =
          cv::imread((*dir / "again" / side / (side + frame + ".png")).string(), cv::IMREAD_GRAYSCALE);
      both = both && cv::findChessboardCorners(image, {9, 6}, corners[i]);
      if (both) cv::cornerSubPix(image, corners[i], {5, 5}, {-1, -1}, {3, 50, 1e-4});
    }
    if (!both) continue;
    for (std::size_t k = 0; k < corners[0].size(); ++k, ++n)
      sum += std::pow(corners[0][k].y - corners[1][k].y, 2);
  }
  ASSERT_GT(n, 200);
  EXPECT_LT(std::sqrt(sum / n), 0.3);
}

TEST_F(Demo, TheSameBytesForAnyNumberOfThreads) {
  for (int threads : {1, 3}) {
    const fs::path out = *dir / ("threads" + std::to_string(threads));
    const test::Run run = test::plumbline("calibrate" + cams + "--target " + (*dir / "board.yaml").string() +
                                          " --lens opencv5 --outliers off --threads " +
                                          std::to_string(threads) + " -o " + out.string());
    ASSERT_EQ(run.exit_code, 0) << run.err;
    EXPECT_EQ(test::read_text(out / "calibration.yaml"), test::read_text(*dir / "pair/calibration.yaml"));
    EXPECT_EQ(test::read_text(out / "corners.yaml"), test::read_text(*dir / "pair/corners.yaml"));
  }
}

TEST_F(Demo, CalibratingFromTheWrittenCornersGivesTheSame) {
  const test::Run run =
      test::plumbline("calibrate --corners " + (*dir / "pair/corners.yaml").string() +
                      " --lens opencv5 --outliers off -o " + (*dir / "from_corners").string());
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(test::read_text(*dir / "from_corners/calibration.yaml"),
            test::read_text(*dir / "pair/calibration.yaml"));
}

TEST_F(Demo, EveryFormatIsWrittenAndReadBack) {
  const std::string native = (*dir / "pair/calibration.yaml").string();
  const Json list = Json::parse(test::plumbline("list formats --json").out);
  int n_readable = 0;
  for (const Json& format : list["formats"]) {
    const std::string name = format["format"], out = (*dir / ("as_" + name)).string();
    const test::Run run = test::plumbline("convert " + native + " --to " + name + " -o " + out);
    if (run.exit_code != 0) {  // a format says so when it cannot hold this lens
      EXPECT_THAT(run.err, ::testing::HasSubstr("kUnsupported")) << name;
      EXPECT_THAT(std::string(format["lenses"]), ::testing::Not(::testing::HasSubstr("opencv5"))) << name;
      continue;
    }
    const test::Run compare = test::plumbline("compare " + native + " " + out + " --max-diff 1e-6");
    EXPECT_EQ(compare.exit_code, 0) << name << ": " << compare.err << compare.out;
    ++n_readable;
  }
  EXPECT_GE(n_readable, 4);
}

TEST_F(Demo, NoFileHoldsAPathOrADate) {
  for (const char* name : {"calibration.yaml", "corners.yaml"}) {
    const std::string text = test::read_text(*dir / "pair" / name);
    EXPECT_EQ(text.find(test::demo_images()->string()), std::string::npos);
    EXPECT_THAT(text, ::testing::Not(::testing::ContainsRegex("20[0-9][0-9]-[0-9][0-9]-[0-9][0-9]")));
  }
}

}  // namespace
}  // namespace plumbline
