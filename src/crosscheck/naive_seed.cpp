// SPDX-License-Identifier: Apache-2.0
#include "crosscheck/naive_seed.hpp"

#include <fmt/format.h>

#include "plumbline/linear/homography.hpp"
#include "plumbline/linear/pose.hpp"
#include "plumbline/linear/zhang.hpp"

namespace plumbline::detail {
namespace {

struct Seen {
  std::vector<Vec3> p_board;
  std::vector<Vec2> px;
};

Seen inliers_of(const Calibration& cal, std::size_t v) {
  Seen seen;
  const View& view = cal.data.views[v];
  if (!cal.T_rig_board[view.frame] || cal.fits[v].size() != view.corners.size()) return seen;
  for (std::size_t c = 0; c < view.corners.size(); ++c) {
    if (cal.fits[v][c].outlier) continue;
    seen.p_board.push_back(cal.data.targets[view.target].points[view.corners[c].point]);
    seen.px.push_back(view.corners[c].px);
  }
  return seen;
}

// fx fy cx cy of a camera from its homographies.
std::optional<Vec4> k_of(const Calibration& cal, int cam) {
  std::vector<Mat3> homographies;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    if (cal.data.views[v].cam != cam) continue;
    const Seen seen = inliers_of(cal, v);
    std::vector<Vec2> board;
    for (const Vec3& p : seen.p_board) board.push_back(p.head<2>());
    if (board.size() < 4) continue;
    if (const auto H = homography(board, seen.px)) homographies.push_back(*H);
  }
  const ImageSize size = cal.rig.cameras[cam].size;
  if (const auto K = zhang_k(homographies, size)) {
    // A centre outside the image comes of distortion; then the focal length alone is the better guess.
    const Vec2 c((*K)(0, 2), (*K)(1, 2));
    if (c.minCoeff() > 0 && c.x() < size.width && c.y() < size.height)
      return Vec4((*K)(0, 0), (*K)(1, 1), c.x(), c.y());
  }
  if (homographies.empty()) return std::nullopt;
  if (const auto f = zhang_focal(homographies, size)) {
    return Vec4(*f, *f, 0.5 * (size.width - 1), 0.5 * (size.height - 1));
  }
  return std::nullopt;
}

// Poses spread from camera 0: a known camera gives its frames a pose, a known frame its cameras.
void spread_poses(Calibration& seed, const Calibration& optimum) {
  const std::size_t n_cams = seed.rig.cameras.size();
  std::vector<bool> known(n_cams, false);
  known[0] = true;
  seed.rig.T_cam_rig[0] = SE3();
  std::vector<std::optional<SE3>> T_cam_board(seed.data.views.size());
  for (std::size_t v = 0; v < T_cam_board.size(); ++v) {
    const Seen seen = inliers_of(optimum, v);
    if (seen.px.size() < 4) continue;
    if (const auto T =
            pose_from_points(seed.rig.cameras[seed.data.views[v].cam].lens, seen.p_board, seen.px)) {
      T_cam_board[v] = *T;
    }
  }
  seed.T_rig_board.assign(optimum.T_rig_board.size(), std::nullopt);
  for (bool changed = true; changed;) {
    changed = false;
    for (std::size_t v = 0; v < T_cam_board.size(); ++v) {
      const View& view = seed.data.views[v];
      auto& T_rig_board = seed.T_rig_board[view.frame];
      if (!T_cam_board[v]) continue;
      if (known[view.cam] && !T_rig_board) {
        T_rig_board = seed.rig.T_cam_rig[view.cam].inverse() * *T_cam_board[v];
        changed = true;
      } else if (!known[view.cam] && T_rig_board) {
        seed.rig.T_cam_rig[view.cam] = *T_cam_board[v] * T_rig_board->inverse();
        known[view.cam] = true;
        changed = true;
      }
    }
  }
}

}  // namespace

NaiveSeed naive_seed(const Calibration& optimum) {
  NaiveSeed out{optimum, ""};
  for (std::size_t cam = 0; cam < optimum.rig.cameras.size(); ++cam) {
    Camera& camera = out.calibration.rig.cameras[cam];
    auto k = k_of(optimum, static_cast<int>(cam));
    if (!k) {
      k = Vec4(1.05 * params(camera.lens)[0], 1.05 * params(camera.lens)[1], 0.5 * (camera.size.width - 1),
               0.5 * (camera.size.height - 1));
      out.note = fmt::format("camera {}: no focal length from the views alone; the seed takes ours and 5 %",
                             camera.name);
    }
    const std::span<double> p = params(camera.lens);
    std::fill(p.begin(), p.end(), 0.0);
    std::copy_n(k->data(), 4, p.begin());
  }
  spread_poses(out.calibration, optimum);
  for (auto& bow : out.calibration.bow_m) {
    if (bow) bow->setZero();
  }
  return out;
}

}  // namespace plumbline::detail
