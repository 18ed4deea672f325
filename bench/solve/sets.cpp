// SPDX-License-Identifier: Apache-2.0
#include "solve/sets.hpp"

#include <cmath>
#include <numbers>
#include <optional>

#include "plumbline/core/random.hpp"
#include "plumbline/geometry/so3.hpp"

namespace bench {
namespace {

using namespace plumbline;

constexpr ImageSize kSize{1920, 1200};
constexpr double kNoisePx = 0.3;

std::vector<double> true_lens(const std::string& name) {
  if (name == "kb4") return {620.5, 619.2, 961.3, 604.8, 0.021, -0.0064, 0.0021, -0.0007};
  if (name == "opencv8")
    return {1201.3, 1199.1, 958.7, 612.4, 0.32, 0.08, 0.0006, -0.0004, 0.006, 0.62, 0.15, 0.018};
  return {1201.3, 1199.1, 958.7, 612.4, -0.28, 0.09, 0.0006, -0.0004, -0.012};
}

Rig true_rig(const std::string& lens, int n_cams) {
  Rig rig;
  Rng rng(11);
  for (int cam = 0; cam < n_cams; ++cam) {
    std::vector<double> k = true_lens(lens);
    if (cam > 0) {
      for (std::size_t i = 0; i < k.size(); ++i)
        k[i] = i < 4 ? k[i] + rng.normal(6) : k[i] * (1 + rng.normal(0.03));
    }
    rig.cameras.push_back({"cam" + std::to_string(cam), kSize, *make_lens(lens, k)});
    const Vec3 w = cam > 0 ? Vec3(rng.normal(0.02), rng.normal(0.02), rng.normal(0.02)) : Vec3(0, 0, 0);
    rig.T_cam_rig.emplace_back(so3_exp(w), Vec3(-(n_cams > 2 ? 0.03 : 0.06) * cam, 0, 0));
  }
  return rig;
}

// The board about a point that the first camera sees.
SE3 random_pose(const Lens& lens, Rng& rng, double depth_more) {
  const Vec3 tilt(rng.uniform(-0.785, 0.785), rng.uniform(-0.785, 0.785),
                  rng.uniform(-0.35, 0.35) + 0.5 * std::numbers::pi * rng.index(4));
  const Mat3 R_tilt =
      so3_exp(Vec3(tilt.x(), 0, 0)) * so3_exp(Vec3(0, tilt.y(), 0)) * so3_exp(Vec3(0, 0, tilt.z()));
  const double distance = std::exp(rng.uniform(std::log(0.28), std::log(0.9))) + depth_more;
  std::optional<Vec3> ray;
  while (!ray) ray = unproject(lens, Vec2(rng.uniform(0, kSize.width), rng.uniform(0, kSize.height)));
  // The board faces the ray before it is tilted.
  const Vec3 x = Vec3(0, 1, 0).cross(*ray).normalized();
  Mat3 R_ray;
  R_ray << x, ray->cross(x), *ray;
  const Mat3 R = R_ray * R_tilt;
  return {R, distance * *ray - R * Vec3(0.135, 0.195, 0)};
}

// The corners, when the whole board is in the image and not beyond 65 degrees from the axis (kb4) or 46.
std::optional<std::vector<Corner>> see(const Camera& camera, const SE3& T, const std::vector<Vec3>& points,
                                       Rng& rng) {
  std::vector<Corner> corners;
  const double least_cosine = is_central_perspective(camera.lens) ? 0.69 : 0.42;
  for (int id = 0; id < static_cast<int>(points.size()); ++id) {
    const Vec3 p = T * points[static_cast<std::size_t>(id)];
    const auto px = project(camera.lens, p);
    if (!px || p.z() < least_cosine * p.norm() || px->x() < 5 || px->y() < 5 || px->x() > kSize.width - 6 ||
        px->y() > kSize.height - 6)
      return std::nullopt;
    corners.push_back({id, *px + Vec2(rng.normal(kNoisePx), rng.normal(kNoisePx)), 1.0});
  }
  return corners;
}

SE3 pushed(const SE3& T, Rng& rng) {
  Vec6 d;
  for (int i = 0; i < 3; ++i) d[i] = rng.normal(0.03);
  for (int i = 3; i < 6; ++i) d[i] = rng.normal(0.03) * T.t().norm();
  return box_plus(T, d);
}

}  // namespace

SolveSet make_set(const std::string& lens, int n_views, int n_cams) {
  SolveSet set;
  const bool splined = lens.starts_with("splined");
  set.truth = true_rig(splined ? "opencv5" : lens, n_cams);
  Calibration& cal = set.start;
  cal.rig = set.truth;
  cal.data.targets = {*make_target(Chessboard{.columns = 10, .rows = 14, .square_m = 0.03})};
  for (const Camera& camera : cal.rig.cameras) cal.data.cameras.push_back({camera.name, camera.size});
  Rng rng(static_cast<std::uint64_t>(1000 * n_views + n_cams));
  while (static_cast<int>(cal.data.frames.size()) < n_views) {
    const SE3 T = random_pose(set.truth.cameras[0].lens, rng, n_cams > 2 ? 0.25 : 0.0);
    std::vector<View> views;
    for (int cam = 0; cam < n_cams; ++cam) {
      auto corners =
          see(set.truth.cameras[cam], set.truth.T_cam_rig[cam] * T, cal.data.targets[0].points, rng);
      if (corners) {
        const int frame = static_cast<int>(cal.data.frames.size());
        views.push_back({cam, frame, std::to_string(frame), *std::move(corners), ""});
      }
    }
    if (static_cast<int>(views.size()) < std::min(n_cams, 4)) continue;
    for (View& view : views) cal.data.views.push_back(std::move(view));
    cal.data.frames.push_back(std::to_string(cal.data.frames.size()));
    cal.T_rig_board.push_back(pushed(T, rng));
  }
  for (Camera& camera : cal.rig.cameras) {
    if (splined) camera.lens = *make_lens(lens, kSize, params(camera.lens)[0]);
    const auto k = params(camera.lens);
    k[0] *= 1.05, k[1] *= 1.05;
    k[2] = 0.5 * (kSize.width - 1), k[3] = 0.5 * (kSize.height - 1);
    for (std::size_t i = 4; i < k.size(); ++i) k[i] = 0;
  }
  for (std::size_t cam = 1; cam < cal.rig.T_cam_rig.size(); ++cam)
    cal.rig.T_cam_rig[cam] =
        box_plus(cal.rig.T_cam_rig[cam], (Vec6() << 0.01, -0.01, 0.01, 0.003, 0.003, -0.003).finished());
  for (const View& view : cal.data.views) cal.fits.emplace_back(view.corners.size());
  cal.view_reason.assign(cal.data.views.size(), "");
  return set;
}

double lens_error_px(const Rig& rig, const Rig& truth) {
  double sum = 0;
  int n = 0;
  for (double y = 0; y < kSize.height; y += 50) {
    for (double x = 0; x < kSize.width; x += 50) {
      const auto ray = unproject(truth.cameras[0].lens, Vec2(x, y));
      const auto px = ray ? project(rig.cameras[0].lens, *ray) : std::nullopt;
      if (!px) continue;
      sum += (*px - Vec2(x, y)).squaredNorm();
      ++n;
    }
  }
  return n > 0 ? std::sqrt(sum / n) : 0;
}

}  // namespace bench
