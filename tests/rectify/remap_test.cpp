// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rectify/remap.hpp"

#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "plumbline/rig/validity.hpp"
#include "rectify/rigs.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

template <class M>
cv::Mat to_cv(const M& m) {
  cv::Mat out(static_cast<int>(m.rows()), static_cast<int>(m.cols()), CV_64F);
  for (int r = 0; r < out.rows; ++r) {
    for (int c = 0; c < out.cols; ++c) out.at<double>(r, c) = m(r, c);
  }
  return out;
}

double largest_difference(const cv::Mat& a, const cv::Mat& b) { return cv::norm(a, b, cv::NORM_INF); }

const Mat3 kTurned = so3_exp(Vec3(0.05, -0.08, 0.1));
const Mat3 kNew = (Mat3() << 500, 0, 410, 0, 490, 305, 0, 0, 1).finished();

TEST(RemapMaps, AgreeWithOpenCV) {
  for (const Lens& lens :
       {Lens(perspective("a").lens), Lens(OpenCV4{530, 531, 320, 240, {-0.2, 0.03, 0.001, 0.002}}),
        Lens(OpenCV8{530, 531, 320, 240, {0.3, -0.1, 0.001, 0.002, 0.01, 0.55, -0.1, 0.02}}),
        Lens(OpenCV12{530, 531, 320, 240, {-0.2, 0.03, 0.001, 0.002, 0, 0, 0, 0, 0.01, 0.002, -0.01, 0.001}}),
        Lens(Pinhole{530, 531, 320, 240})}) {
    const Camera camera{"c", {640, 480}, lens};
    const auto k = params(lens);
    cv::Mat K, R, N, x, y, D(1, static_cast<int>(k.size()) - 4, CV_64F, const_cast<double*>(k.data() + 4));
    K = to_cv(camera_matrix_k(lens)), R = to_cv(kTurned), N = to_cv(kNew);
    cv::initUndistortRectifyMap(K, k.size() > 4 ? D : cv::Mat(), R, N, {800, 600}, CV_32FC1, x, y);
    const RemapMaps ours = remap_maps(camera, kTurned, kNew, {800, 600});
    EXPECT_LT(largest_difference(ours.x, x), 1e-3) << lens_name(lens);
    EXPECT_LT(largest_difference(ours.y, y), 1e-3) << lens_name(lens);
  }
}

TEST(RemapMaps, AgreeWithOpenCVsFisheye) {
  const Camera camera = fisheye("f", 150);
  const auto k = params(camera.lens);
  cv::Mat K, R, N, x, y, D(1, 4, CV_64F, const_cast<double*>(k.data() + 4));
  K = to_cv(camera_matrix_k(camera.lens)), R = to_cv(kTurned), N = to_cv(kNew);
  cv::fisheye::initUndistortRectifyMap(K, D, R, N, {800, 600}, CV_32FC1, x, y);
  const RemapMaps ours = remap_maps(camera, kTurned, kNew, {800, 600});
  EXPECT_LT(largest_difference(ours.x, x), 1e-3);
  EXPECT_LT(largest_difference(ours.y, y), 1e-3);
}

// The maps against the definition, pixel by pixel, also where the lens' domain ends inside the new image.
TEST(RemapMaps, AreTheLensAtEachPixel) {
  for (const Camera& camera : {perspective("a"), fisheye("f", 190),
                               Camera{"folding", {640, 480}, OpenCV4{300, 300, 320, 240, {-0.3, 0, 0, 0}}}}) {
    Mat3 K = kNew;
    K(0, 0) = K(1, 1) = 130;  // 144 degrees across
    const RemapMaps maps = remap_maps(camera, kTurned, K, {800, 600});
    int valid = 0, silent = 0;
    for (int row = 0; row < 600; ++row) {
      for (int col = 0; col < 800; ++col) {
        const auto px = project(camera.lens, kTurned.transpose() * K.inverse() * Vec3(col, row, 1));
        if (!px) {
          ++silent;
          ASSERT_EQ(maps.x.at<float>(row, col), -1) << row << " " << col;
          ASSERT_EQ(maps.y.at<float>(row, col), -1);
          continue;
        }
        // far outside the image a float has fewer decimals
        ASSERT_NEAR(maps.x.at<float>(row, col), px->x(), 3e-4 + 2e-7 * px->norm())
            << camera.name << " " << row << " " << col;
        ASSERT_NEAR(maps.y.at<float>(row, col), px->y(), 3e-4 + 2e-7 * px->norm());
        valid += px->x() >= -0.5 && px->y() >= -0.5 && px->x() <= camera.size.width - 0.5 &&
                 px->y() <= camera.size.height - 0.5;
      }
    }
    EXPECT_NEAR(maps.valid_fraction, valid / 480000.0, 2e-5);
    if (camera.name == "folding") EXPECT_GT(silent, 1000);
  }
}

TEST(RemapMaps, DoNotDependOnTheThreadCount) {
  const Camera camera = fisheye("f", 190);
  const RemapMaps one = remap_maps(camera, kTurned, kNew, {801, 603}, 1),
                  four = remap_maps(camera, kTurned, kNew, {801, 603}, 4);
  EXPECT_EQ(largest_difference(one.x, four.x), 0);
  EXPECT_EQ(largest_difference(one.y, four.y), 0);
  EXPECT_EQ(one.valid_fraction, four.valid_fraction);
}

// A picture drawn by formula: what the rectified image shows at a pixel is the scene in that direction.
TEST(RemapImage, ShowsTheSceneWhereTheMapsPoint) {
  const Camera camera = perspective("a");
  cv::Mat image(480, 640, CV_8UC1);
  const auto grey = [](double x, double y) { return 128 + 60 * std::sin(x / 23) + 50 * std::cos(y / 31); };
  for (int row = 0; row < 480; ++row) {
    for (int col = 0; col < 640; ++col) image.at<uchar>(row, col) = cv::saturate_cast<uchar>(grey(col, row));
  }
  Mat3 K = kNew;
  K(0, 0) = K(1, 1) = 330;  // wide enough to show what is beyond the image
  const RemapMaps maps = remap_maps(camera, kTurned, K, {800, 600});
  const cv::Mat out = remap_image(image, maps);
  ASSERT_EQ(out.size(), cv::Size(800, 600));
  int black = 0;
  for (int row = 5; row < 600; row += 10) {
    for (int col = 5; col < 800; col += 10) {
      const auto px = project(camera.lens, kTurned.transpose() * K.inverse() * Vec3(col, row, 1));
      if (!px) continue;
      const bool inside = px->x() > 0 && px->y() > 0 && px->x() < 639 && px->y() < 479;
      const bool outside = px->x() < -1 || px->y() < -1 || px->x() > 640 || px->y() > 480;
      // 1.5: rounding of the image and of the result, half a level each, and the sine between two pixels
      if (inside) EXPECT_NEAR(out.at<uchar>(row, col), grey(px->x(), px->y()), 1.5);
      if (outside) {
        EXPECT_EQ(out.at<uchar>(row, col), 0);
        ++black;
      }
    }
  }
  EXPECT_GT(black, 100);
}

// Beyond a camera's validity no pixel is mapped, and the share of valid pixels counts the rest.
TEST(RemapMaps, LeaveOutWhatLiesBeyondTheValidity) {
  Camera camera = perspective("a");
  const auto all = remap_maps(camera, Mat3::Identity(), kNew, {800, 600});
  camera.validity = validity_of(camera.lens, 0.35);
  const auto maps = remap_maps(camera, Mat3::Identity(), kNew, {800, 600});
  int n_valid = 0;
  for (int row = 0; row < 600; ++row) {
    for (int col = 0; col < 800; ++col) {
      const Vec3 ray = kNew.inverse() * Vec3(col, row, 1);
      const double angle = std::atan(std::hypot(ray.x(), ray.y()));
      const float x = maps.x.at<float>(row, col), y = maps.y.at<float>(row, col);
      if (angle > 0.35) {
        ASSERT_EQ(x, -1) << col << " " << row;
        continue;
      }
      // In a tile that the border crosses pixels are exact, elsewhere interpolated, to 5e-5 px each.
      ASSERT_NEAR(x, all.x.at<float>(row, col), 2e-4) << col << " " << row;
      n_valid += x >= -0.5 && y >= -0.5 && x <= 639.5 && y <= 479.5;
    }
  }
  EXPECT_NEAR(maps.valid_fraction, n_valid / (800.0 * 600.0), 1e-12);
  EXPECT_LT(maps.valid_fraction, 0.9 * all.valid_fraction);
}

TEST(RemapMaps, TheUndistortedCameraShowsWhatIsValid) {
  Camera camera = perspective("a");
  camera.validity = validity_of(camera.lens, 0.35);
  const auto inner = undistorted_camera(camera, 0, {}), outer = undistorted_camera(camera, 1, {});
  ASSERT_TRUE(inner && outer);
  EXPECT_NEAR(remap_maps(camera, Mat3::Identity(), camera_matrix_k(*inner), camera.size).valid_fraction, 1,
              2e-3);
  // All of the disc: its edge, tan(0.35) from the axis, touches the border.
  EXPECT_NEAR(camera.size.width / outer->fx, 2 * std::tan(0.35), 0.01);
}

}  // namespace
}  // namespace plumbline::test
