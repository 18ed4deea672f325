// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "plumbline/refine/bundle.hpp"
#include "refine_support.hpp"

/// Scenes of known truth for bundle adjustment. Pixels come from OpenCV's projection.
namespace plumbline::test {

struct BundleScene {
  int n_views = 20, n_points = 200;
  std::vector<std::string> lenses{"opencv5"};  ///< views take the cameras in turn
  double seen = 1;                             ///< share of the points that each view sees
  std::uint64_t seed = 1;
};

/// A camera 4 to 6 m from the middle of a cloud of 2 m, looking at it, from all over a wide arc.
inline SE3 pose_around(Rng& rng) {
  const double around = rng.uniform(-1.2, 1.2), up = rng.uniform(-0.6, 0.6);
  const Mat3 R =
      so3_exp(Vec3(0, 0, rng.uniform(-0.5, 0.5))) * so3_exp(Vec3(up, 0, 0)) * so3_exp(Vec3(0, around, 0));
  return {R, Vec3(rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), rng.uniform(4, 6))};
}

inline Reconstruction make_scene(const BundleScene& spec) {
  Rng rng(spec.seed);
  Reconstruction scene;
  for (const std::string& name : spec.lenses) {
    Lens lens = example_lens(name);
    scene.cameras.push_back({"camera" + std::to_string(scene.cameras.size() + 1), {640, 480}, lens});
  }
  for (int v = 0; v < spec.n_views; ++v) {
    const int camera = v % static_cast<int>(spec.lenses.size());
    scene.views.push_back({camera, "img" + std::to_string(v) + ".jpg", pose_around(rng), v + 1});
  }
  for (int p = 0; p < spec.n_points; ++p)
    scene.p_world.emplace_back(rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1));
  for (int p = 0; p < spec.n_points; ++p) {
    for (int v = 0; v < spec.n_views; ++v) {
      if (rng.uniform() > spec.seen) continue;
      const ReconstructionView& view = scene.views[v];
      const auto px = project_by_opencv(scene.cameras[view.camera].lens, view.T_cam_world * scene.p_world[p]);
      if (px) scene.sightings.push_back({v, p, *px, 1.0});
    }
  }
  return scene;
}

inline void add_noise(Reconstruction& scene, double sigma_px, Rng& rng) {
  for (Sighting& s : scene.sightings) {
    s.px += Vec2(rng.normal(sigma_px), rng.normal(sigma_px));
    s.sigma_px = sigma_px;
  }
}

/// Moves what is not in `held` by about `rad` and `length`.
inline Reconstruction perturbed(Reconstruction scene, double rad, double length, Rng& rng,
                                const std::vector<int>& held_views = {}) {
  for (std::size_t v = 0; v < scene.views.size(); ++v) {
    if (std::find(held_views.begin(), held_views.end(), static_cast<int>(v)) != held_views.end()) continue;
    Vec6 d;
    for (int i = 0; i < 6; ++i) d[i] = rng.normal(i < 3 ? rad : length);
    scene.views[v].T_cam_world = box_plus(scene.views[v].T_cam_world, d);
  }
  for (Vec3& p : scene.p_world) p += Vec3(rng.normal(length), rng.normal(length), rng.normal(length));
  return scene;
}

/// The scene scaled about a point.
inline Reconstruction scaled(Reconstruction scene, double scale, const Vec3& about) {
  for (Vec3& p : scene.p_world) p = about + scale * (p - about);
  for (ReconstructionView& view : scene.views) {
    const Mat3 R = view.T_cam_world.R();
    view.T_cam_world = SE3(R, -R * (about + scale * (view.T_cam_world.centre() - about)));
  }
  return scene;
}

/// Largest distance of corresponding points, and of corresponding centres.
inline double worst_distance(const Reconstruction& a, const Reconstruction& b) {
  double worst = 0;
  for (std::size_t p = 0; p < a.p_world.size(); ++p)
    worst = std::max(worst, (a.p_world[p] - b.p_world[p]).norm());
  for (std::size_t v = 0; v < a.views.size(); ++v)
    worst = std::max(worst, (a.views[v].T_cam_world.centre() - b.views[v].T_cam_world.centre()).norm());
  return worst;
}

}  // namespace plumbline::test
