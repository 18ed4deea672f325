// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <regex>
#include <string>
#include <vector>

#include "plumbline/core/text.hpp"
#include "plumbline/target/target.hpp"

namespace plumbline::test {

/// A folder of the optional photographs, what was photographed, and in how many images it can be found at
/// least.
struct DataSet {
  std::string folder, pattern;
  TargetSpec spec;
  int images, found;
};

inline std::vector<std::filesystem::path> images_of(const std::filesystem::path& folder,
                                                    const std::string& pattern) {
  std::vector<std::filesystem::path> out;
  const std::regex name(pattern);
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (std::regex_match(entry.path().filename().string(), name)) out.push_back(entry.path());
  }
  std::sort(out.begin(), out.end(),
            [](const auto& a, const auto& b) { return natural_less(a.string(), b.string()); });
  return out;
}

inline std::vector<DataSet> data_sets() {
  const std::string cv = "opencv_extra/cameracalibration", image = ".*\\.(png|jpg|JPG|bmp)";
  const auto chess = [](int c, int r) { return Chessboard{c, r, 0.025}; };
  const auto circles = [](int c, int r, bool asymmetric) { return Circles{c, r, 0.02, 0, asymmetric}; };
  const Charuco photonvision{8, 8, 0.0254, 0.01905, "4X4_50"}, wpical{12, 8, 0.015586, 0.012123, "5X5_1000"};
  const Charuco caliscope{4, 5, 0.054, 0.0405, "4X4_1000"}, yizhong{9, 7, 0.04, 0.02, "4X4_100"};
  const AprilGrid kalibr{6, 6, 0.088, 0.3};
  return {
      {"opencv_leftright", image, chess(9, 6), 26, 26},
      {cv + "/fisheye/calib-3_stereo_from_JY/left", image, chess(8, 6), 34, 34},
      {cv + "/fisheye/calib-3_stereo_from_JY/right", image, chess(8, 6), 34, 34},
      {cv, "chess[1-7].png", chess(5, 7), 7, 7},
      {cv, "chess8.png", chess(4, 6), 1, 1},
      {cv, "chess9.png", chess(19, 21), 1, 1},
      {cv, "negative_.*png", chess(6, 7), 2, 0},
      {cv + "/subpixel", image, chess(5, 4), 10, 10},
      {cv + "/omnidir/omnidir_images", image, chess(9, 6), 5, 4},
      {"boofcv_calibration/stereo/Bumblebee2_Chess", image, chess(4, 6), 22, 22},
      {"boofcv_calibration/trinocular/left", image, chess(13, 9), 15, 13},
      {"boofcv_calibration/trinocular/middle", image, chess(13, 9), 15, 13},
      {"boofcv_calibration/trinocular/right", image, chess(13, 9), 15, 13},
      {"boofcv_calibration/fisheye/chessboard", image, chess(4, 6), 26, 26},
      {"boofcv_calibration/mono/Sony_DSC-HX5V_Chess", image, chess(4, 6), 13, 13},
      {"camodocal", image, chess(9, 6), 13, 13},
      {"stereopi_fisheye/pairs", image, chess(9, 6), 26, 26},
      {"vins_camera_models/calibrationdata", image, chess(12, 8), 15, 15},
      {"udacity_camera_cal", image, chess(9, 6), 10, 9},
      {"pyocamcalib/fish_1", image, chess(8, 6), 15, 15},
      {"photonvision/calibrationSquaresImg/lifecam/2024-01-02_lifecam_1280", image, chess(10, 10), 14, 14},
      {"photonvision/calibrationSquaresImg/piCam/640_480_1", image, chess(7, 7), 25, 25},
      {"photonvision_1280x720", image, chess(10, 10), 6, 5},
      {"photonvision/calibrationCharucoImg/lifecam/2024-05-07_lifecam_1280", image, photonvision, 16, 16},
      {"photonvision/calibrationCharucoImg/lifecam/2024-05-07_lifecam_480", image, photonvision, 17, 17},
      {"wpical_frames/charuco_1920x1080", image, wpical, 5, 5},
      {"caliscope_frames/post_optimization/cam_0", image, caliscope, 15, 15},
      {"caliscope_frames/post_optimization/cam_1", image, caliscope, 15, 12},
      {"caliscope_frames/post_optimization/cam_2", image, caliscope, 15, 12},
      {"caliscope_frames/post_optimization/cam_3", image, caliscope, 15, 9},
      {"yizhong_toolkit/intrinsic_calib_charuco_test_images", image, yizhong, 7, 7},
      {"aprilgrid_rs/tests/data", "TUM_VI.*png|r45.*|right.*|top.*", kalibr, 4, 4},
      {"aprilgrid_rs/data", image, kalibr, 1, 1},
      {"aprilgrid_rs/tests/data", "EuRoC.png", kalibr, 1, 1},
      {"aprilgrid_rs/tests/data", "iphone.png", AprilGrid{11, 6, 0.088, 0.3}, 1, 1},
      {"aprilgrid_py/example/data", image, kalibr, 1, 1},
      {"camera_intrinsic_rs/data", "euroc.png", kalibr, 1, 1},
      {"yac_euroc_april/stereo", image, kalibr, 2, 2},
      {cv + "/circles", image, circles(7, 7, false), 8, 8},
      {cv + "/asymmetric_circles", "acircles[1-3].png", circles(7, 13, true), 2, 2},
      {cv + "/asymmetric_circles", "acircles[4-6].png", circles(5, 5, true), 2, 2},
      {cv + "/asymmetric_circles", "acircles[7-9].png", circles(3, 9, true), 2, 2},
      {"boofcv_calibration/mono/Sony_DSC-HX5V_CircleRegular", image, circles(10, 8, false), 6, 6},
  };
}

}  // namespace plumbline::test
