// SPDX-License-Identifier: Apache-2.0
// Two videos of a board through the program: sampled, paired, thinned, drawn, calibrated, and undistorted.
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "support/support.hpp"

namespace plumbline {
namespace {
namespace fs = std::filesystem;
using Json = nlohmann::json;

class Videos : public ::testing::Test {
 protected:
  // Frames of a simulated rig, each for four frames of which one is sharp; the first view is there twice
  // more.
  static void SetUpTestSuite() {
    dir = new test::TempDir;
    test::write_text(*dir / "board.yaml", "type: chessboard\ncorners: [7, 5]\nsquare_m: 0.03\n");
    const test::Run simulated = test::plumbline(
        "simulate --target " + (*dir / "board.yaml").string() +
        " --lens opencv4 --fov 60 --size 480x360 --views 6 --cams 2 --seed 3 -o " + (*dir / "sim").string());
    ASSERT_EQ(simulated.exit_code, 0) << simulated.err;
    for (const std::string cam : {"cam0", "cam1"}) {
      cv::VideoWriter video((*dir / (cam + ".avi")).string(), cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 30,
                            {480, 360});
      ASSERT_TRUE(video.isOpened());
      for (int window = 0; window < 8; ++window) {
        const int view = window < 6 ? window : 0;
        const cv::Mat sharp = cv::imread(*dir / "sim" / cam / ("00" + std::to_string(view) + ".png"));
        ASSERT_FALSE(sharp.empty());
        cv::Mat blurred;
        cv::GaussianBlur(sharp, blurred, {}, 2);
        for (int k = 0; k < 4; ++k) video.write(k == window % 3 ? sharp : blurred);
      }
    }
    cams = " --cam cam0=" + (*dir / "cam0.avi").string() + " --cam cam1=" + (*dir / "cam1.avi").string() +
           " --target " + (*dir / "board.yaml").string();
  }
  static void TearDownTestSuite() { delete dir; }

  static inline test::TempDir* dir = nullptr;
  static inline std::string cams;
};

TEST_F(Videos, DetectSamplesThinsAndDraws) {
  const std::string out = (*dir / "corners.yaml").string(), drawn = (*dir / "drawn").string();
  const test::Run run =
      test::plumbline("detect --every 4 --json --threads 2" + cams + " -o " + out + " --draw " + drawn);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const Json report = Json::parse(run.out);
  EXPECT_EQ(report["notes"].size(), 2U) << report["notes"];
  ASSERT_EQ(report["views"].size(), 16U);
  const std::vector<std::string> frames{"000000", "000005", "000010", "000012",
                                        "000017", "000022", "000024", "000029"};
  int n_found = 0;
  for (int v = 0; v < 16; ++v) {
    const Json& view = report["views"][v];
    EXPECT_EQ(view["image"], std::string(v < 8 ? "cam0" : "cam1") + ".avi#" + frames[v % 8]);
    n_found += view["corners"].get<int>() > 0;
    if (v % 8 > 5) {
      EXPECT_THAT(view["reason"].get<std::string>(),
                  testing::StartsWith("near-duplicate of frame 000000: corners moved by 0."))
          << view;
    }
  }
  EXPECT_GE(n_found, 8);  // whole boards; simulated views may have a part outside of the image
  for (const char* file : {"contact_sheet.png", "cam0/cam0_000005.png", "cam1/cam1_000029.png"})
    EXPECT_FALSE(cv::imread(*dir / "drawn" / file).empty()) << file;

  // The same bytes with one thread; --force may replace what --draw made, since all of it is ours.
  const std::string again = (*dir / "again.yaml").string();
  const test::Run one = test::plumbline("detect --every 4 --json --threads 1 --force" + cams + " -o " +
                                        again + " --overlay " + drawn);
  ASSERT_EQ(one.exit_code, 0) << one.err;
  EXPECT_EQ(one.out, run.out);
  EXPECT_EQ(test::read_text(out), test::read_text(again));

  const test::Run whole = test::plumbline("detect --every 4 --thin 0 --json --force" + cams + " -o " + again);
  ASSERT_EQ(whole.exit_code, 0) << whole.err;
  EXPECT_EQ(whole.out.find("near-duplicate"), std::string::npos);
}

TEST_F(Videos, CalibrateAndUndistort) {
  const std::string out = (*dir / "calibration").string();
  const test::Run run = test::plumbline("calibrate --every 4 --lens opencv4 --json" + cams + " -o " + out);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const Json report = Json::parse(run.out);
  EXPECT_EQ(report["notes"].size(), 2U);
  int n_thinned = 0;  // frames 24 and 29 of both cameras, which no later search brings back
  for (const Json& view : report["views"]) {
    const bool is_thinned = view["reason"].is_string() &&
                            view["reason"].get<std::string>().starts_with("near-duplicate of frame 000000");
    n_thinned += is_thinned;
    if (is_thinned) {
      EXPECT_EQ(view["corners"], 0);
    }
  }
  EXPECT_EQ(n_thinned, 4);
  const test::Run undistorted =
      test::plumbline("undistort " + out + " --every 16 --cam cam0=" + (*dir / "cam0.avi").string() + " -o " +
                      (*dir / "und").string());
  ASSERT_EQ(undistorted.exit_code, 0) << undistorted.err;
  EXPECT_FALSE(cv::imread(*dir / "und" / "cam0" / "cam0_000000.png").empty());
}

TEST_F(Videos, OneLineForABadVideo) {
  test::write_text(*dir / "bad.mp4", std::string(3000, 'x'));
  const test::Run run = test::plumbline("detect --cam a=" + (*dir / "bad.mp4").string() + " --target " +
                                        (*dir / "board.yaml").string() + " -o " + (*dir / "x.yaml").string());
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.err, testing::HasSubstr("bad.mp4: no video that can be decoded"));
  EXPECT_EQ(std::count(run.err.begin(), run.err.end(), '\n'), 1) << run.err;
}

// 16-bit files stay 16-bit ones when they are undistorted.
TEST_F(Videos, SixteenBitsAreKept) {
  test::write_text(
      *dir / "camera.yaml",
      "%YAML:1.0\n---\nimage_width: 64\nimage_height: 48\ncamera_matrix: !!opencv-matrix\n  rows: 3\n"
      "  cols: 3\n  dt: d\n  data: [50., 0., 31.5, 0., 50., 23.5, 0., 0., 1.]\n"
      "distortion_coefficients: !!opencv-matrix\n  rows: 1\n  cols: 5\n  dt: d\n"
      "  data: [0., 0., 0., 0., 0.]\n");
  cv::Mat image(48, 64, CV_16UC1, cv::Scalar(300));
  image.at<unsigned short>(20, 30) = 3001;
  cv::imwrite(*dir / "deep.png", image);
  const test::Run run = test::plumbline("undistort " + (*dir / "camera.yaml").string() +
                                        " --alpha 1 --cam a=" + (*dir / "deep.png").string() + " -o " +
                                        (*dir / "deep").string());
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const cv::Mat out = cv::imread(*dir / "deep" / "a" / "deep.png", cv::IMREAD_UNCHANGED);
  ASSERT_EQ(out.type(), CV_16UC1);
  EXPECT_EQ(out.at<unsigned short>(20, 40), 300);
}

}  // namespace
}  // namespace plumbline
