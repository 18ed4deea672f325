// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <fmt/format.h>

#include <functional>

#include "refine/refine_support.hpp"

/// Rigs of several cameras before several boards, with known truth.
namespace plumbline::test {

constexpr double kRadPerDeg = std::numbers::pi / 180;

struct RigCamera {
  Lens lens;
  ImageSize size{640, 480};
  SE3 T_cam_rig;
};

/// A rig that moves through a world in which boards stand. Camera and board frames as everywhere: x right, y
/// down, z forward or into the board.
struct RigScene {
  std::vector<RigCamera> cameras;
  std::vector<TargetSpec> boards;
  std::vector<SE3> T_world_board;
  std::vector<SE3> T_rig_world;  ///< one per frame
};

/// Whether two cameras ever see the same board in the same frame.
inline bool share_a_board(const Dataset& data, int cam1, int cam2) {
  for (const View& a : data.views) {
    for (const View& b : data.views) {
      if (a.corners.empty() || b.corners.empty()) continue;
      if (a.cam == cam1 && b.cam == cam2 && a.frame == b.frame && a.target == b.target) return true;
    }
  }
  return false;
}

/// Boards seen whole from their printed side, at up to 65 degrees. The calibration holds the truth, ready for
/// refine().
inline Calibration simulate_rig(const RigScene& scene) {
  Calibration truth;
  for (std::size_t b = 0; b < scene.boards.size(); ++b) {
    truth.data.targets.push_back(
        *make_target(scene.boards[b], "board" + std::string(1, static_cast<char>('A' + b))));
    if (b > 0) truth.T_board0_board.push_back(scene.T_world_board[0].inverse() * scene.T_world_board[b]);
  }
  for (std::size_t i = 0; i < scene.cameras.size(); ++i) {
    const RigCamera& camera = scene.cameras[i];
    const std::string name = "cam" + std::to_string(i);
    truth.data.cameras.push_back({name, camera.size});
    truth.rig.cameras.push_back({name, camera.size, camera.lens});
    truth.rig.T_cam_rig.push_back(camera.T_cam_rig);
  }
  for (std::size_t f = 0; f < scene.T_rig_world.size(); ++f) {
    truth.data.frames.push_back("f" + std::to_string(f));
    truth.T_rig_board.emplace_back(scene.T_rig_world[f] * scene.T_world_board[0]);
  }
  for (int cam = 0; cam < static_cast<int>(scene.cameras.size()); ++cam) {
    const RigCamera& camera = scene.cameras[cam];
    for (int f = 0; f < static_cast<int>(scene.T_rig_world.size()); ++f) {
      for (int b = 0; b < static_cast<int>(scene.boards.size()); ++b) {
        const SE3 T = camera.T_cam_rig * scene.T_rig_world[f] * scene.T_world_board[b];
        View view{cam, f, fmt::format("cam{}/f{}.png", cam, f), {}, "not seen", b};
        const auto& points = truth.data.targets[b].points;
        const Vec3 middle = T * Vec3(0.5 * (points.front() + points.back()));
        const bool faces = T.R().col(2).dot(middle.normalized()) > std::cos(65 * kRadPerDeg);
        for (int id = 0; faces && id < static_cast<int>(points.size()); ++id) {
          const Vec3 p_cam = T * points[id];
          const auto px = project_by_opencv(camera.lens, p_cam);
          const bool wide = lens_name(camera.lens) == "kb4";
          if (!px || px->minCoeff() < 0 || px->x() > camera.size.width - 1 ||
              px->y() > camera.size.height - 1)
            continue;
          if (!wide && p_cam.head<2>().norm() > 1.2 * p_cam.z()) continue;
          view.corners.push_back({id, *px, 1.0});
        }
        if (view.corners.size() == points.size())
          view.reason.clear();
        else
          view.corners.clear();
        truth.fits.emplace_back(view.corners.size());
        truth.view_reason.push_back("");
        truth.data.views.push_back(std::move(view));
      }
    }
  }
  return truth;
}

/// Rotation about the vertical (y down): turns z towards x.
inline Mat3 yaw(double deg) { return so3_exp(Vec3(0, deg * kRadPerDeg, 0)); }

/// A camera at `out_m` from the rig's middle that looks at an azimuth.
inline SE3 camera_at(double azimuth_deg, double out_m) {
  const Mat3 R_rig_cam = yaw(azimuth_deg);
  return SE3(R_rig_cam, R_rig_cam * Vec3(0, 0, out_m)).inverse();
}

/// A board at an azimuth that faces the middle, tilted by a rotation vector in its own frame; its points are
/// centred there.
inline SE3 board_at(double azimuth_deg, double distance_m, const TargetSpec& spec,
                    const Vec3& tilt = Vec3::Zero()) {
  const auto points = make_target(spec)->points;
  const Vec3 middle = 0.5 * (points.front() + points.back());
  const SE3 T(yaw(azimuth_deg), yaw(azimuth_deg) * Vec3(0, 0, distance_m));
  return T * SE3(so3_exp(tilt), Vec3::Zero()) * SE3(Mat3::Identity(), -middle);
}

inline Vec3 random_tilt(Rng& rng, double most_deg) {
  const double around = rng.uniform(0, 2 * std::numbers::pi),
               tilt = rng.uniform(0.4, 1) * most_deg * kRadPerDeg;
  return {tilt * std::cos(around), tilt * std::sin(around), rng.uniform(-0.4, 0.4)};
}

}  // namespace plumbline::test
