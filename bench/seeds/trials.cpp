// SPDX-License-Identifier: Apache-2.0
#include "seeds/trials.hpp"

#include <cmath>
#include <numbers>

#include "plumbline/core/random.hpp"
#include "plumbline/geometry/so3.hpp"

namespace bench {
namespace {

using namespace plumbline;

constexpr ImageSize kSize{1280, 960};
constexpr double kDeg = std::numbers::pi / 180;

// Distortion moves the edge of the field by up to some 15 % of its distance from the centre.
Lens random_lens(const TrialKind& kind, Rng& rng) {
  const double half = 0.5 * kind.fov_deg * kDeg;
  const Vec2 centre(0.5 * (kSize.width - 1) + rng.uniform(-0.15, 0.15) * kSize.width,
                    0.5 * (kSize.height - 1) + rng.uniform(-0.15, 0.15) * kSize.height);
  const double a = rng.uniform(-0.12, 0.12), b = rng.uniform(-0.04, 0.04), c = rng.uniform(-0.01, 0.01);
  if (kind.lens == "kb4") {
    const double s = half * half, f = 0.5 * kSize.width / (half * (1 + a + b + c));
    const std::vector<double> k{
        f, f * rng.uniform(0.99, 1.01), centre.x(), centre.y(), a / s, b / (s * s), c / (s * s * s), 0};
    return *make_lens("kb4", k);
  }
  // At the far corner of an image whose centre is off, the radius is 1.6 times that of the side.
  const double r = 1.6 * std::tan(half), s = r * r, f = 0.5 * kSize.width / std::tan(half);
  const std::vector<double> k{f,
                              f * rng.uniform(0.99, 1.01),
                              centre.x(),
                              centre.y(),
                              a / s,
                              b / (s * s),
                              rng.normal(5e-4),
                              rng.normal(5e-4),
                              c / (s * s * s)};
  return *make_lens("opencv5", k);
}

SE3 random_pose(const TrialKind& kind, double tilt, const Vec3& middle, double size_m, Rng& rng) {
  const double off = rng.uniform(0, 0.4 * kind.fov_deg) * kDeg, around = rng.uniform(0, 2 * std::numbers::pi);
  const double covers = std::min(90.0, kind.fov_deg) * rng.uniform(0.3, 0.7) * kDeg;
  const Mat3 R_cam_ray = so3_exp(Vec3(-std::sin(around), std::cos(around), 0) * off);
  const double tilt_around = rng.uniform(0, 2 * std::numbers::pi);
  const Mat3 R = R_cam_ray * so3_exp(Vec3(std::cos(tilt_around), std::sin(tilt_around), 0) * tilt) *
                 so3_exp(Vec3(0, 0, rng.uniform(-0.5, 0.5)));
  return {R, R_cam_ray * Vec3(0, 0, 0.5 * size_m / std::tan(0.5 * covers)) - R * middle};
}

}  // namespace

Calibration make_trial(const TrialKind& kind, std::uint64_t seed) {
  Rng rng(seed);
  Calibration cal;
  cal.data.targets = {*make_target(Chessboard{.columns = 9, .rows = 6, .square_m = 0.025})};
  cal.data.cameras = {{"cam", kSize}};
  cal.rig.cameras = {{"cam", kSize, random_lens(kind, rng)}};
  cal.rig.T_cam_rig = {SE3()};
  const std::vector<Vec3>& points = cal.data.targets[0].points;
  const Vec3 middle = 0.5 * (points.front() + points.back());
  const double size_m = (points.back() - points.front()).norm();
  while (static_cast<int>(cal.data.views.size()) < kind.n_views) {
    const int n = static_cast<int>(cal.data.views.size());
    const double tilt = rng.uniform(n < 3 ? 15 : 0, 45) * kDeg;
    const SE3 T = random_pose(kind, tilt, middle, size_m, rng);
    View view{0, n, std::to_string(n) + ".png", {}, "", 0};
    for (int id = 0; id < static_cast<int>(points.size()); ++id) {
      const Vec3 p = T * points[static_cast<std::size_t>(id)];
      if (p.z() < std::cos(0.5 * kind.fov_deg * kDeg * 1.1) * p.norm() && kind.lens == "kb4") continue;
      const auto px = project(cal.rig.cameras[0].lens, p);
      if (!px || px->x() < 0 || px->y() < 0 || px->x() > kSize.width - 1 || px->y() > kSize.height - 1)
        continue;
      view.corners.push_back({id, *px + Vec2(rng.normal(kind.noise_px), rng.normal(kind.noise_px)), 1.0});
    }
    if (view.corners.size() < 12) continue;
    cal.data.frames.push_back(std::to_string(n));
    cal.data.views.push_back(view);
    cal.T_rig_board.push_back(T);
    cal.fits.emplace_back(view.corners.size());
  }
  cal.view_reason.assign(cal.data.views.size(), "");
  return cal;
}

}  // namespace bench
