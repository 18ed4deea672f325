// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <optional>
#include <string>
#include <vector>

#include "plumbline/core/random.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/refine/refine.hpp"
#include "support/lens_samples.hpp"
#include "support/support.hpp"

/// Simulated data with known truth. Pixels come from OpenCV's projection, not from the lenses under test.
namespace plumbline::test {

/// Pixel by cv::projectPoints; the fisheye by its definition (Kannala & Brandt 2006, eq. 6), because
/// cv::fisheye::projectPoints is wrong beyond 90 degrees; the lenses that OpenCV does not have by their plain
/// definition. nullopt behind a perspective camera.
inline std::optional<Vec2> project_by_opencv(const Lens& lens, const Vec3& p_cam) {
  const auto k = params(lens);
  if (lens_name(lens) == "kb4") {
    const double theta = std::acos(p_cam.z() / p_cam.norm()), phi = std::atan2(p_cam.y(), p_cam.x());
    double d = theta;
    for (int i = 0; i < 4; ++i) d += k[4 + i] * std::pow(theta, 3 + 2 * i);
    return Vec2(k[0] * d * std::cos(phi) + k[2], k[1] * d * std::sin(phi) + k[3]);
  }
  if (!is_central_perspective(lens)) return project_plainly(lens, p_cam);
  if (p_cam.z() <= 0) return std::nullopt;
  const cv::Matx33d K(k[0], 0, k[2], 0, k[1], k[3], 0, 0, 1);
  const std::vector<double> D(k.begin() + 4, k.end());
  std::vector<cv::Point2d> px;
  cv::projectPoints(std::vector<cv::Point3d>{{p_cam.x(), p_cam.y(), p_cam.z()}}, cv::Vec3d(), cv::Vec3d(), K,
                    D, px);
  return Vec2(px[0].x, px[0].y);
}

struct Simulation {
  Calibration truth;                     ///< rig, poses and the data without noise; fits and stats are empty
  std::vector<std::vector<Vec3>> p_cam;  ///< per view, per corner: the true point in the camera [m]
};

struct Scene {
  std::vector<Lens> lenses;
  ImageSize size{640, 480};
  double fov_deg = 60;  ///< horizontal; boards are spread over it
  int n_frames = 20;
  double baseline_m = 0.1;
  double max_tilt_deg = 45;
  TargetSpec target = Chessboard{.columns = 9, .rows = 6, .square_m = 0.025};
  std::uint64_t seed = 1;
  double widest_tan =
      1.2;  ///< of the angle off the axis, beyond which no corner is seen (fisheyes: no limit)
};

inline SE3 random_board_pose(const Scene& scene, const Target& target, Rng& rng) {
  const double deg = std::numbers::pi / 180;
  Vec3 low = target.points[0], high = low;
  for (const Vec3& p : target.points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const double size_m = (high - low).norm();
  // The ray to the board's middle, up to two thirds of the way to the image's edge, and a distance at which
  // the board covers a third to two thirds of the view.
  const double off = rng.uniform(0, 0.33 * scene.fov_deg) * deg,
               around = rng.uniform(0, 2 * std::numbers::pi);
  const double covers = std::min(90.0, scene.fov_deg) * rng.uniform(0.35, 0.7) * deg;
  const double distance_m = 0.5 * size_m / std::tan(0.5 * covers);
  const Mat3 R_cam_ray = so3_exp(Vec3(-std::sin(around), std::cos(around), 0) * off);
  const double tilt_around = rng.uniform(0, 2 * std::numbers::pi);
  const double tilt = rng.uniform(0, scene.max_tilt_deg) * deg;
  const Mat3 R = R_cam_ray * so3_exp(Vec3(std::cos(tilt_around), std::sin(tilt_around), 0) * tilt) *
                 so3_exp(Vec3(0, 0, rng.uniform(-0.3, 0.3)));
  return {R, R_cam_ray * Vec3(0, 0, distance_m) - R * (0.5 * (low + high))};
}

/// Corners inside the images; views with fewer than 12 are left out.
inline Simulation simulate(const Scene& scene) {
  Rng rng(scene.seed);
  Simulation sim;
  Calibration& truth = sim.truth;
  truth.data.targets = {*make_target(scene.target)};
  for (std::size_t i = 0; i < scene.lenses.size(); ++i) {
    const std::string name = "cam" + std::to_string(i);
    truth.data.cameras.push_back({name, scene.size});
    truth.rig.cameras.push_back({name, scene.size, scene.lenses[i]});
    const double n = static_cast<double>(i);
    truth.rig.T_cam_rig.push_back(i == 0 ? SE3()
                                         : SE3(so3_exp(Vec3(0.02 * n, -0.05 * n, 0.01)),
                                               Vec3(-scene.baseline_m * n, 0.004 * n, 0.003)));
  }
  for (int f = 0; f < scene.n_frames; ++f) {
    truth.data.frames.push_back(std::to_string(f));
    truth.T_rig_board.push_back(random_board_pose(scene, truth.data.targets[0], rng));
  }
  for (int cam = 0; cam < static_cast<int>(scene.lenses.size()); ++cam) {
    for (int f = 0; f < scene.n_frames; ++f) {
      View view{cam, f, truth.data.cameras[cam].name + "/" + std::to_string(f) + ".png", {}, ""};
      std::vector<Vec3> points;
      for (int id = 0; id < static_cast<int>(truth.data.targets[0].points.size()); ++id) {
        const Vec3 p_cam =
            truth.rig.T_cam_rig[cam] * (*truth.T_rig_board[f] * truth.data.targets[0].points[id]);
        const auto px = project_by_opencv(scene.lenses[cam], p_cam);
        if (!px || px->x() < 0 || px->y() < 0 || px->x() > scene.size.width - 1 ||
            px->y() > scene.size.height - 1)
          continue;
        // The image of a polynomial lens folds back far outside; those points are not seen.
        const bool wide = !is_central_perspective(scene.lenses[cam]);
        if (!wide && p_cam.head<2>().norm() > scene.widest_tan * p_cam.z()) continue;
        view.corners.push_back({id, *px, 1.0});
        points.push_back(p_cam);
      }
      if (view.corners.size() < 12) continue;
      truth.data.views.push_back(view);
      sim.p_cam.push_back(points);
    }
  }
  return sim;
}

inline Dataset with_noise(Dataset data, double sigma_px, std::uint64_t seed) {
  Rng rng(seed);
  for (View& view : data.views) {
    for (Corner& c : view.corners) {
      c.px.x() += rng.normal(sigma_px);
      c.px.y() += rng.normal(sigma_px);
    }
  }
  return data;
}

/// Largest distance [px] between the true pixels and where the calibrated lenses put the true points of the
/// cameras.
inline double worst_lens_error_px(const Simulation& sim, const Calibration& cal) {
  double worst = 0;
  for (std::size_t v = 0; v < sim.p_cam.size(); ++v) {
    const View& view = sim.truth.data.views[v];
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      const auto px = project(cal.rig.cameras[view.cam].lens, sim.p_cam[v][i]);
      worst = std::max(worst, px ? (*px - view.corners[i].px).norm() : 1e9);
    }
  }
  return worst;
}

inline double focal_px(ImageSize size, double fov_deg, bool fisheye) {
  const double half = 0.5 * fov_deg * std::numbers::pi / 180;
  return fisheye ? 0.5 * size.width / half : 0.5 * size.width / std::tan(half);
}

/// A lens of each kind with plausible distortion for about 60 degrees, off centre.
inline Lens example_lens(std::string_view name, double focal = 550) {
  return lens_like_glass(name, {focal, focal * 1.003, 328.3, 236.1});
}

/// mrcal's corners file: "name x y [level]" in board order. Views of the cameras whose names start with these
/// prefixes.
inline Dataset read_vnl(const std::filesystem::path& file, const std::vector<std::string>& prefixes,
                        ImageSize size, const TargetSpec& target) {
  Dataset data;
  data.targets = {*make_target(target)};
  for (const std::string& prefix : prefixes) data.cameras.push_back({prefix, size});
  std::map<std::string, std::vector<Corner>> views;
  std::map<std::string, int> next;
  for (const std::string& line : split(read_text(file), '\n')) {
    const auto words = split(line, ' ');
    if (words.size() < 3 || line.starts_with('#')) continue;
    const int point = next[words[0]]++;
    if (words[1] != "-") views[words[0]].push_back({point, {std::stod(words[1]), std::stod(words[2])}, 1.0});
  }
  for (std::size_t cam = 0; cam < prefixes.size(); ++cam) {
    for (const auto& [name, corners] : views) {
      if (!name.starts_with(prefixes[cam])) continue;
      const std::string key = name.substr(prefixes[cam].size());
      auto frame = std::find(data.frames.begin(), data.frames.end(), key);
      if (frame == data.frames.end()) frame = data.frames.insert(frame, key);
      data.views.push_back(
          {static_cast<int>(cam), static_cast<int>(frame - data.frames.begin()), name, corners, ""});
    }
  }
  return data;
}

}  // namespace plumbline::test
