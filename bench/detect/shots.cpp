// SPDX-License-Identifier: Apache-2.0
#include "detect/shots.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "plumbline/core/random.hpp"
#include "plumbline/synth/render.hpp"
#include "plumbline/synth/scene.hpp"

namespace plumbline::bench {
namespace {

constexpr double kDeg = std::numbers::pi / 180;

Mat3 turn(double deg, const Vec3& axis) { return Eigen::AngleAxisd(deg * kDeg, axis).toRotationMatrix(); }

double unit_m(const TargetSpec& spec) {
  if (const auto* chess = std::get_if<Chessboard>(&spec)) return chess->square_m;
  if (const auto* charuco = std::get_if<Charuco>(&spec)) return charuco->square_m;
  return std::get<AprilGrid>(spec).tag_m;
}

/// The sheet's rim lies in the image: finders need the white around the board.
bool is_whole(const BoardDrawing& sheet, const Camera& camera, const SE3& T_cam_board) {
  const Vec2 low = sheet.sheet_low(), size = sheet.sheet_high() - low;
  for (int i = 0; i < 16; ++i) {
    const double a = (i % 4) / 4.0;
    const Vec2 at = i < 4 ? Vec2(a, 0) : i < 8 ? Vec2(1, a) : i < 12 ? Vec2(1 - a, 1) : Vec2(0, 1 - a);
    const Vec2 p = low + size.cwiseProduct(at);
    const auto px = project(camera.lens, T_cam_board * Vec3(p.x(), p.y(), 0));
    if (!px || px->x() < 1 || px->y() < 1 || px->x() > camera.size.width - 2 ||
        px->y() > camera.size.height - 2)
      return false;
  }
  return true;
}

/// A pose that the kind asks for, or nullopt: the draw did not fit.
std::optional<SE3> draw_pose(const Subject& subject, const Kind& kind, const Camera& camera,
                             const BoardDrawing& sheet, Rng& rng) {
  const double margin = kind.is_partial ? 0.0 : 0.12;
  const Vec2 place((margin + (1 - 2 * margin) * rng.uniform()) * camera.size.width,
                   (margin + (1 - 2 * margin) * rng.uniform()) * camera.size.height);
  const auto ray = unproject(camera.lens, place);
  if (!ray) return std::nullopt;
  const Vec3 away = *ray;
  const auto beside = project(camera.lens, away + 1e-4 * away.unitOrthogonal());
  if (!beside) return std::nullopt;
  const double px_per_rad = (*beside - place).norm() / 1e-4;
  const double unit_px = kind.is_small ? rng.uniform(subject.small_low_px, subject.small_high_px)
                                       : rng.uniform(subject.low_px, subject.high_px);
  const double scale = camera.size.width / 1920.0;
  const double distance = px_per_rad * unit_m(subject.spec) / (kind.is_small ? unit_px : unit_px * scale);
  // The sheet faces the camera along the ray, then it is turned and tilted.
  const Mat3 facing = Eigen::Quaterniond::FromTwoVectors(Vec3::UnitZ(), away).toRotationMatrix();
  const double direction = rng.uniform(0, 360), tilt = rng.uniform(kind.tilt_low_deg, kind.tilt_high_deg);
  const Vec3 axis(std::cos(direction * kDeg), std::sin(direction * kDeg), 0);
  Mat3 R = facing * turn(tilt, axis) * turn(rng.uniform(-25, 25), Vec3::UnitZ());
  if (sheet.y_up) R = R * turn(180, Vec3::UnitX());
  const Vec2 middle = (sheet.low + sheet.high) / 2;
  return SE3(R, away * distance - R * Vec3(middle.x(), middle.y(), 0));
}

Camera camera_of(const Kind& kind, ImageSize size, std::uint64_t seed) {
  return {"cam", size, *simulated_lens(kind.lens, kind.fov_deg, size, true, seed)};
}

ImageSize scaled(ImageSize size, bool is_quick) {
  return is_quick ? ImageSize{size.width / 2, size.height / 2} : size;
}

cv::Mat with_noise(cv::Mat grey, double sigma, std::uint64_t seed) {
  cv::RNG random(seed);
  cv::Mat noise(grey.size(), CV_32F), sum;
  random.fill(noise, cv::RNG::NORMAL, 0, sigma);
  grey.convertTo(sum, CV_32F);
  cv::Mat(sum + noise).convertTo(sum, CV_8U);
  return sum;
}

cv::Mat stripes(ImageSize size, Rng& rng) {
  cv::Mat image(size.height, size.width, CV_8U);
  const double angle = rng.uniform(0, 3), period = rng.uniform(20, 50), c = std::cos(angle),
               s = std::sin(angle);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      // A shirt: the cloth bends the stripes.
      const double bent = c * x + s * y + 12 * std::sin(0.008 * x) + 9 * std::cos(0.011 * y);
      image.at<unsigned char>(y, x) = std::fmod(bent + 1e4 * period, period) < period / 2 ? 40 : 200;
    }
  }
  return image;
}

cv::Mat text(ImageSize size, Rng& rng) {
  cv::Mat image(size.height, size.width, CV_8U, cv::Scalar(225));
  for (int y = 24; y < size.height; y += 26) {
    std::string line;
    while (line.size() < 160) line += static_cast<char>('!' + rng.index(90));
    cv::putText(image, line, {6, y}, cv::FONT_HERSHEY_SIMPLEX, 0.7, cv::Scalar(25), 2, cv::LINE_AA);
  }
  return image;
}

Subject other_board(const Subject& subject) {
  if (std::holds_alternative<Chessboard>(subject.spec))
    return {"other", Chessboard{6, 5, 0.03}, 50, 80, 12, 14};
  if (std::holds_alternative<Charuco>(subject.spec))
    return {"other", Charuco{9, 7, 0.03, 0.022, "5X5_250"}, 70, 90, 30, 34};
  return {"other", AprilGrid{5, 5, 0.088, 0.3, "36h11", 300}, 90, 110, 40, 44};
}

}  // namespace

std::vector<Subject> subjects() {
  return {{"chessboard 10x7", Chessboard{10, 7, 0.03}, 45, 80, 10, 12},
          {"chessboard 10x10", Chessboard{10, 10, 0.03}, 45, 80, 10, 12},
          {"ChArUco 11x8", Charuco{11, 8, 0.03, 0.022, "5X5_100"}, 50, 85, 26, 32},
          {"AprilGrid 6x6", AprilGrid{6, 6, 0.088, 0.3}, 60, 100, 28, 34},
          {"AprilGrid 5x5 25h9, border of one", AprilGrid{5, 5, 0.088, 0.3, "25h9", 0, 1}, 70, 110, 28, 34}};
}

std::vector<Kind> kinds() {
  Kind hard{"blurred and noisy"}, blurred{"blurred"}, noisy{"noisy"}, tilted{"tilted 60 deg"};
  Kind fisheye{"fisheye 180 deg"}, dark{"vignetted"}, jpeg{"JPEG 70"}, partial{"half out"}, small{"small"};
  Kind large{"clean, 12 Mpx"}, large_hard{"blurred and noisy, 12 Mpx"};
  hard.blur_px = 1.6, hard.noise = 9, hard.contrast = 85;
  blurred.blur_px = 3;
  noisy.noise = 15;
  tilted.tilt_low_deg = tilted.tilt_high_deg = 60;
  fisheye.lens = "kb4", fisheye.fov_deg = 180;
  dark.vignetting = 0.8;
  jpeg.jpeg_quality = 70;
  partial.is_partial = true;
  small.is_small = true;
  large.size = large_hard.size = {4096, 3000};
  large.blur_px = 0.9;
  large_hard.blur_px = 2.2, large_hard.noise = 9, large_hard.contrast = 85;
  return {{"clean"}, hard, blurred, noisy, tilted, fisheye, dark, jpeg, partial, small, large, large_hard};
}

std::vector<Shot> shots(const Subject& subject, const Kind& kind, int n, std::uint64_t seed, bool is_quick) {
  const ImageSize size = scaled(kind.size, is_quick);
  const Target target = *make_target(subject.spec);
  const auto drawings = *draw_target(target);
  const Camera camera = camera_of(kind, size, seed);
  const CameraRays rays = camera_rays(camera.lens, size);
  Rng rng(seed);
  std::vector<Shot> out;
  for (int attempt = 0; attempt < 20000 && static_cast<int>(out.size()) < n; ++attempt) {
    const auto pose = draw_pose(subject, kind, camera, drawings[0], rng);
    if (!pose) continue;
    Shot shot;
    shot.truth = visible_corners(target, drawings, camera, *pose);
    const double share = static_cast<double>(shot.truth.size()) / static_cast<double>(target.points.size());
    if (kind.is_partial ? share < 0.35 || share > 0.65 : share < 1 || !is_whole(drawings[0], camera, *pose))
      continue;
    for (int i = 0; i < static_cast<int>(target.points.size()); ++i) {
      const auto is_i = [&](const Corner& c) { return c.point == i; };
      const auto px = project(camera.lens, *pose * target.points[static_cast<std::size_t>(i)]);
      if (px && std::none_of(shot.truth.begin(), shot.truth.end(), is_i)) shot.rim.push_back({i, *px, 1});
    }
    RenderOptions how;
    how.white_grey = 115 + kind.contrast / 2, how.black_grey = 115 - kind.contrast / 2;
    how.background_grey = 110, how.texture_grey = 35;
    how.blur_sigma_px = kind.blur_px, how.vignetting = kind.vignetting, how.noise_grey = kind.noise;
    how.seed = seed + out.size();
    shot.grey = render(drawings, rays, *pose, how);
    if (kind.jpeg_quality > 0) {
      std::vector<unsigned char> bytes;
      cv::imencode(".jpg", shot.grey, bytes, {cv::IMWRITE_JPEG_QUALITY, kind.jpeg_quality});
      shot.grey = cv::imdecode(bytes, cv::IMREAD_GRAYSCALE);
    }
    out.push_back(std::move(shot));
  }
  return out;
}

std::vector<std::string> empty_kinds() { return {"noise", "stripes", "text", "other board", "mirrored"}; }

std::vector<Shot> empty_shots(const Subject& subject, const std::string& kind, int n, std::uint64_t seed,
                              bool is_quick) {
  std::vector<Shot> out;
  const bool is_chess = std::holds_alternative<Chessboard>(subject.spec);
  if (kind == "mirrored" && is_chess) return out;
  if (kind == "mirrored" || kind == "other board") {
    out = shots(kind == "mirrored" ? subject : other_board(subject), kinds()[0], n, seed, is_quick);
    for (Shot& shot : out) {
      shot.truth.clear();
      shot.rim.clear();
      if (kind == "mirrored") cv::flip(shot.grey, shot.grey, 1);
    }
    return out;
  }
  Rng rng(seed);
  // findChessboardCorners takes a minute for 2 Mpx of noise.
  const ImageSize size = scaled(kind == "noise" ? ImageSize{640, 400} : ImageSize{1920, 1200}, is_quick);
  for (int i = 0; i < n; ++i) {
    cv::Mat image(size.height, size.width, CV_8U, cv::Scalar(115));
    if (kind == "stripes") image = stripes(size, rng);
    if (kind == "text") image = text(size, rng);
    out.push_back({with_noise(image, kind == "noise" ? 40 : 3, seed + i), {}, {}});
  }
  return out;
}

}  // namespace plumbline::bench
