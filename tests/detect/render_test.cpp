// SPDX-License-Identifier: Apache-2.0
#include "detect/render.hpp"

#include <cmath>
#include <memory>
#include <numbers>
#include <opencv2/aruco.hpp>
#include <opencv2/imgproc.hpp>

#include "plumbline/core/parallel.hpp"
#include "support/support.hpp"

namespace plumbline::test {

std::optional<Vec2> PlaneCamera::board_of(const Vec2& px) const {
  Vec3 ray;
  const Vec2 d = (px - centre) / f;
  if (is_fisheye) {
    const double theta = d.norm();
    if (theta > 1.5) return std::nullopt;
    const double s = theta > 1e-9 ? std::sin(theta) / theta : 1;
    ray = Vec3(s * d.x(), s * d.y(), std::cos(theta));
  } else {
    ray = Vec3(d.x(), d.y(), 1);
  }
  const Vec3 ray_board = R.transpose() * ray, centre_board = -R.transpose() * t;
  const double k = -centre_board.z() / ray_board.z();
  if (!(k > 0)) return std::nullopt;
  return Vec2((centre_board + k * ray_board).head<2>());
}

Vec2 PlaneCamera::px_of(const Vec3& p_board) const {
  const Vec3 p = R * p_board + t;
  const double r = p.head<2>().norm();
  if (!is_fisheye) return centre + f * p.head<2>() / p.z();
  return centre + (r > 1e-12 ? f * std::atan2(r, p.z()) / r : f / p.z()) * p.head<2>();
}

PlaneCamera look_at(const Target& target, double pitch_deg, double yaw_deg, double roll_deg,
                    double distance) {
  Vec3 low = target.points[0], high = target.points[0];
  for (const Vec3& p : target.points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  constexpr double kDeg = std::numbers::pi / 180;
  const auto turn = [&](double deg, const Vec3& axis) {
    return Eigen::AngleAxisd(deg * kDeg, axis).toRotationMatrix();
  };
  Mat3 facing = Mat3::Identity();
  if (std::holds_alternative<AprilGrid>(target.spec)) facing = turn(180, Vec3::UnitX());
  PlaneCamera camera;
  camera.R =
      turn(roll_deg, Vec3::UnitZ()) * turn(pitch_deg, Vec3::UnitX()) * turn(yaw_deg, Vec3::UnitY()) * facing;
  // Off the optical axis and not at whole pixels, so that no symmetry hides an error.
  camera.t = Vec3(0.021, -0.013, distance) * (high - low).head<2>().maxCoeff() - camera.R * (low + high) / 2;
  return camera;
}

Shade chessboard_shade(const Chessboard& board) {
  return [=](const Vec2& p) {
    const double x = p.x() / board.square_m + 1,
                 y = p.y() / board.square_m + 1;  // squares from the drawn corner
    if (x < -1 || y < -1 || x > board.columns + 2 || y > board.rows + 2) return -1.0;
    if (x < 0 || y < 0 || x > board.columns + 1 || y > board.rows + 1) return 1.0;
    return (static_cast<int>(x) + static_cast<int>(y)) % 2 == 0 ? 0.0 : 1.0;  // the top-left square is black
  };
}

namespace {

/// Module (row, column) of a marker with its border, 0 black or 255 white.
cv::Mat marker_modules(int dictionary, int id, int border) {
  const auto d = cv::aruco::getPredefinedDictionary(dictionary);
  cv::Mat image;
  cv::aruco::drawMarker(d, id, d->markerSize + 2 * border, image, border);
  return image;
}

double module_at(const cv::Mat& modules, double u, double v) {  // u right, v down, 0..1
  const int c = std::min(static_cast<int>(u * modules.cols), modules.cols - 1);
  const int r = std::min(static_cast<int>(v * modules.rows), modules.rows - 1);
  return modules.at<unsigned char>(r, c) > 127 ? 1.0 : 0.0;
}

}  // namespace

Shade charuco_shade(const Charuco& board, bool legacy, bool negative) {
  auto modules =
      std::make_shared<std::vector<std::vector<cv::Mat>>>(board.rows, std::vector<cv::Mat>(board.columns));
  const int dictionary = board.dictionary == "5X5_100" ? cv::aruco::DICT_5X5_100 : cv::aruco::DICT_4X4_50;
  int id = board.first_id;
  const auto is_white = [=](int c, int r) {
    return legacy && board.rows % 2 == 0 ? (c + r) % 2 == 0 : (c + r) % 2 == 1;
  };
  for (int r = 0; r < board.rows; ++r)
    for (int c = 0; c < board.columns; ++c)
      if (is_white(c, r)) (*modules)[r][c] = marker_modules(dictionary, id++, 1);
  const double margin = (1 - board.marker_m / board.square_m) / 2;
  return [=](const Vec2& p) {
    const double x = p.x() / board.square_m + 1, y = p.y() / board.square_m + 1;
    if (x < -1 || y < -1 || x > board.columns + 1 || y > board.rows + 1) return -1.0;
    if (x < 0 || y < 0 || x >= board.columns || y >= board.rows) return negative ? 0.0 : 1.0;
    const int c = static_cast<int>(x), r = static_cast<int>(y);
    const double u = (x - c - margin) / (1 - 2 * margin), v = (y - r - margin) / (1 - 2 * margin);
    double shade = is_white(c, r) ? 1.0 : 0.0;
    if (is_white(c, r) && u > 0 && v > 0 && u < 1 && v < 1) shade = module_at((*modules)[r][c], u, v);
    return negative ? 1 - shade : shade;
  };
}

Shade aprilgrid_shade(const AprilGrid& board) {
  auto modules = std::make_shared<std::vector<cv::Mat>>();
  for (int t = 0; t < board.columns * board.rows; ++t) {
    cv::Mat tag;  // AprilTag's families are turned by half a turn in OpenCV's drawing
    const int family =
        board.family == "25h9" ? cv::aruco::DICT_APRILTAG_25h9 : cv::aruco::DICT_APRILTAG_36h11;
    cv::rotate(marker_modules(family, board.first_id + t, board.border), tag, cv::ROTATE_180);
    modules->push_back(tag);
  }
  return [=](const Vec2& p) {
    const double s = board.spacing, pitch = 1 + s, x = p.x() / board.tag_m, y = p.y() / board.tag_m;  // y up
    const double right = board.columns * pitch, top = board.rows * pitch;
    if (x < -2 * s || y < -2 * s || x > right + s || y > top + s) return -1.0;
    if (x < -s || y < -s || x > right || y > top) return 1.0;
    const int c = static_cast<int>(std::floor(x / pitch)), r = static_cast<int>(std::floor(y / pitch));
    const double u = x - c * pitch, v = y - r * pitch;
    if (u > 1 || v > 1 || c < 0 || r < 0 || c >= board.columns || r >= board.rows) {
      // The gaps: a black square where gaps cross.
      const bool gap_x = u > 1 || c<0, gap_y = v> 1 || r < 0;
      return gap_x && gap_y ? 0.0 : 1.0;
    }
    return module_at((*modules)[static_cast<std::size_t>(r * board.columns + c)], u, 1 - v);
  };
}

Shade circles_shade(const Circles& board, double diameter_m) {
  return [=](const Vec2& p) {
    const double s = board.spacing_m, x = p.x() / s, y = p.y() / s, radius = diameter_m / 2 / s;
    const double right = board.asymmetric ? 2 * board.columns - 1 : board.columns - 1;
    if (x < -2 || y < -2 || x > right + 2 || y > board.rows + 1) return -1.0;
    for (int r = std::max(0, static_cast<int>(y) - 1); r <= std::min(board.rows - 1, static_cast<int>(y) + 2);
         ++r) {
      const double step = board.asymmetric ? 2 : 1, first = board.asymmetric ? r % 2 : 0;
      const double c = std::clamp(std::round((x - first) / step), 0.0, board.columns - 1.0);
      if ((Vec2(first + step * c, r) - Vec2(x, y)).norm() < radius) return 0.0;
    }
    return 1.0;
  };
}

cv::Mat render(const PlaneCamera& camera, const Shade& shade, const Render& how) {
  cv::Mat image(camera.size.height, camera.size.width, CV_32F);
  parallel_for(camera.size.height, 0, [&](int v) {
    for (int u = 0; u < camera.size.width; ++u) {
      double sum = 0;
      for (int j = 0; j < how.samples; ++j) {
        for (int i = 0; i < how.samples; ++i) {
          const Vec2 px(u + (i + 0.5) / how.samples - 0.5, v + (j + 0.5) / how.samples - 0.5);
          const auto p = camera.board_of(px);
          const double s = p ? shade(*p) : -1;
          sum += s < 0 ? how.background : how.black + s * (how.white - how.black);
        }
      }
      image.at<float>(v, u) = static_cast<float>(sum / how.samples / how.samples);
    }
  });
  if (how.blur_px > 0) cv::GaussianBlur(image, image, cv::Size(), how.blur_px);
  cv::Mat noise(image.size(), CV_32F), out;
  cv::RNG random(how.seed);
  random.fill(noise, cv::RNG::NORMAL, 0, how.noise);
  cv::Mat(image + noise).convertTo(out, CV_8U);
  return out;
}

Accuracy accuracy(const Detection& detection, const Target& target, const PlaneCamera& camera) {
  Accuracy a;
  for (const Corner& c : detection.corners) {
    const Vec2 e = c.px - camera.px_of(target.points[static_cast<std::size_t>(c.point)]);
    ++a.found;
    a.mean_error += e.norm();
    a.worst = std::max(a.worst, e.norm());
    a.rms_axis += e.squaredNorm() / 2;
    a.mean_sigma += c.sigma_px;
    a.bias += e;
  }
  if (a.found == 0) return a;
  a.mean_error /= a.found;
  a.rms_axis = std::sqrt(a.rms_axis / a.found);
  a.mean_sigma /= a.found;
  a.bias /= a.found;
  return a;
}

// The renderer judges the detectors, so it is judged itself: the pixel of a board point is on that board
// point.
TEST(Render, PixelAndBoardPointAreInverse) {
  const Target target = *make_target(AprilGrid{});
  PlaneCamera camera = look_at(target, 25, -30, 40);
  for (const bool fisheye : {false, true}) {
    camera.is_fisheye = fisheye;
    for (const Vec3& p : target.points) {
      const auto back = camera.board_of(camera.px_of(p));
      ASSERT_TRUE(back);
      EXPECT_NEAR((*back - p.head<2>()).norm(), 0, 1e-12);
    }
  }
}

}  // namespace plumbline::test
