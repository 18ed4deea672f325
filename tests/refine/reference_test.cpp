// SPDX-License-Identifier: Apache-2.0
// Real corners, against other software: cv::calibrateCamera run here, and mrcal's answers.
#include <opencv2/core.hpp>

#include "plumbline/refine/refine.hpp"
#include "refine_support.hpp"

namespace plumbline::test {
namespace {

const TargetSpec kDemoBoard = Chessboard{.columns = 9, .rows = 6, .square_m = 0.025};

RefineOptions squares_only(std::string_view lens) {
  RefineOptions options;
  options.lenses = {std::string(lens)};
  options.mark_outliers = false;
  return options;
}

std::optional<Dataset> demo_corners(const std::vector<std::string>& cameras) {
  const auto dir = data_dir("../reference");
  if (!dir) return std::nullopt;
  return read_vnl(*dir / "corners-fcc.vnl", cameras, {640, 480}, kDemoBoard);
}

// mrcal without its regularisation, and Ceres with automatic differentiation, gave these ten digits
// (docs/refine.md).
TEST(Reference, DemoLeftReachesTheOptimumOfMrcal) {
  const auto data = demo_corners({"left"});
  PLUMBLINE_NEEDS(data);
  const auto cal = calibrate(*data, squares_only("opencv5"));
  ASSERT_TRUE(cal) << cal.error().text();
  EXPECT_NEAR(params(cal->rig.cameras[0].lens)[0], 532.8271004, 1e-5);
  EXPECT_EQ(cal->stats.n_corners, 13 * 54);
  EXPECT_TRUE(cal->stats.weak.empty());
}

TEST(Reference, DemoPairReachesTheJointOptimumOfMrcal) {
  const auto data = demo_corners({"left", "right"});
  PLUMBLINE_NEEDS(data);
  const auto cal = calibrate(*data, squares_only("opencv5"));
  ASSERT_TRUE(cal) << cal.error().text();
  EXPECT_NEAR(params(cal->rig.cameras[0].lens)[0], 533.4165465, 1e-5);
  EXPECT_TRUE(cal->stats.weak.empty());
}

// Largest distance [px] between our projection and OpenCV's over the image: each pixel's ray of ours,
// projected by cv::projectPoints.
double worst_difference_px(const Lens& lens, ImageSize size, const cv::Mat& K, const cv::Mat& D) {
  double worst = 0;
  for (int y = 0; y < size.height; y += 16) {
    for (int x = 0; x < size.width; x += 16) {
      const auto ray = unproject(lens, Vec2(x, y));
      if (!ray) continue;
      std::vector<cv::Point2d> px;
      cv::projectPoints(std::vector<cv::Point3d>{{ray->x(), ray->y(), ray->z()}}, cv::Vec3d(), cv::Vec3d(), K,
                        D, px);
      worst = std::max(worst, std::hypot(px[0].x - x, px[0].y - y));
    }
  }
  return worst;
}

TEST(Reference, ProjectsLikeCalibrateCameraOverTheWholeImage) {
  for (const char* camera : {"left", "right"}) {
    for (const char* lens : {"opencv4", "opencv5"}) {
      const auto data = demo_corners({camera});
      PLUMBLINE_NEEDS(data);
      const auto cal = calibrate(*data, squares_only(lens));
      ASSERT_TRUE(cal) << cal.error().text();
      std::vector<std::vector<cv::Point3f>> board;
      std::vector<std::vector<cv::Point2f>> px;
      for (const View& view : data->views) {
        board.emplace_back();
        px.emplace_back();
        for (const Corner& c : view.corners) {
          const Vec3& p = data->targets[0].points[c.point];
          board.back().emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()), 0.f);
          px.back().emplace_back(static_cast<float>(c.px.x()), static_cast<float>(c.px.y()));
        }
      }
      cv::Mat K, D;
      std::vector<cv::Mat> r, t;
      const int flags = std::string(lens) == "opencv4" ? cv::CALIB_FIX_K3 : 0;
      const double rms = cv::calibrateCamera(board, px, {640, 480}, K, D, r, t, flags,
                                             {cv::TermCriteria::EPS + cv::TermCriteria::COUNT, 300, 1e-15});
      EXPECT_NEAR(cal->stats.rms_px, rms, 1e-5) << camera << " " << lens;
      EXPECT_LT(worst_difference_px(cal->rig.cameras[0].lens, {640, 480}, K, D), 0.01)
          << camera << " " << lens;
    }
  }
}

// The 30 frames of EuRoC's camera calibration span 1.5 s; the recording beside it stands in for them where
// the board keeps its tilt, and every 30th frame of the long one is a good calibration.
Dataset read_yac(const std::filesystem::path& dir, std::size_t first, std::size_t count) {
  Dataset data;
  data.targets = {*make_target(AprilGrid{.columns = 6, .rows = 6, .tag_m = 0.088, .spacing = 0.3})};
  data.cameras = {{"cam0", {752, 480}}};
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(dir)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  for (std::size_t i = first; i < std::min(files.size(), first + count); ++i) {
    View view{0, static_cast<int>(data.frames.size()), files[i].filename(), {}, ""};
    for (const std::string& line : split(read_text(files[i]), '\n')) {
      const auto words = split(line, ',');
      if (words.size() < 12 || line.starts_with('#')) continue;
      view.corners.push_back(
          {4 * std::stoi(words[10]) + std::stoi(words[11]), {std::stod(words[5]), std::stod(words[6])}, 1.0});
    }
    std::sort(view.corners.begin(), view.corners.end(),
              [](const Corner& a, const Corner& b) { return a.point < b.point; });
    data.frames.push_back(files[i].stem());
    data.views.push_back(view);
  }
  return data;
}

TEST(Reference, EurocIsNotWeakButTenFramesOfItsSequenceAre) {
  const auto dir = data_dir("yac_euroc_april");
  PLUMBLINE_NEEDS(dir);
  const auto good = calibrate(read_yac(*dir / "imu_april" / "cam0", 0, 100), squares_only("opencv4"));
  ASSERT_TRUE(good) << good.error().text();
  EXPECT_TRUE(good->stats.weak.empty()) << good->stats.weak[0].consequence;
  EXPECT_NEAR(params(good->rig.cameras[0].lens)[0], 458.654, 0.01 * 458.654);  // published by Kalibr

  const auto weak = calibrate(read_yac(*dir / "sequence" / "cam0", 260, 10), squares_only("opencv4"));
  if (weak) {
    ASSERT_FALSE(weak->stats.weak.empty()) << params(weak->rig.cameras[0].lens)[0];
    EXPECT_NE(weak->stats.weak[0].parameters.find("cam0 f"), std::string::npos);
    // The flag is deserved: the error is beyond what the covariance alone predicts.
    const double error_px = std::abs(params(weak->rig.cameras[0].lens)[0] - 458.654);
    EXPECT_GT(error_px, 3 * std::sqrt((*weak->covariance)(0, 0)));
  } else {
    EXPECT_EQ(weak.error().code, ErrorCode::kDegenerate);
  }
}

}  // namespace
}  // namespace plumbline::test
