// SPDX-License-Identifier: Apache-2.0
#pragma once
/// Two views with known truth, for the tests of epipolar geometry.
#include <vector>

#include "linear/scenes.hpp"
#include "plumbline/linear/epipolar.hpp"

namespace plumbline::test {

enum class Scene { kDeep, kPlane, kTurn };

struct TwoViews {
  Mat3 K1, K2;
  SE3 T_2_1;
  Mat3 F;  ///< |F| = 1; meaningless for Scene::kTurn
  std::vector<Vec3> p_1;
  std::vector<Vec2> px1, px2;
};

inline constexpr ImageSize kImage{640, 480};

inline Vec2 noisy(Rng& rng, const Vec2& px, double sigma) {
  const double x = rng.normal(sigma);
  return px + Vec2(x, rng.normal(sigma));
}

/// n points that both cameras see inside their images: 3 to 9 baselines away, on a tilted plane, or seen by
/// a camera that turns in place.
inline TwoViews two_views(Rng& rng, int n, Scene scene = Scene::kDeep, double sigma_px = 0,
                          bool same_k = true) {
  TwoViews s;
  s.K1 = random_k(rng, kImage);
  s.K2 = same_k ? s.K1 : random_k(rng, kImage);
  const Vec3 w = rng.uniform(0.05, 0.3) * random_direction(rng);
  const Vec3 t = scene == Scene::kTurn ? Vec3(Vec3::Zero()) : random_direction(rng);
  s.T_2_1 = SE3(so3_exp(w), t);
  const Vec3 middle(0, 0, 6), normal = (random_direction(rng) + Vec3(0, 0, 2)).normalized();
  while (static_cast<int>(s.p_1.size()) < n) {
    const double x = rng.uniform(0, kImage.width - 1);
    const Vec2 px(x, rng.uniform(0, kImage.height - 1));
    const Vec3 ray = s.K1.inverse() * px.homogeneous();
    const double depth = scene == Scene::kPlane ? normal.dot(middle) / normal.dot(ray) : rng.uniform(3, 9);
    const Vec3 q = s.T_2_1 * (depth * ray);
    if (!(depth > 1 && depth < 30 && q.z() > 1)) continue;
    const Vec2 other = pinhole(s.K2, q);
    if (other.x() < 0 || other.y() < 0 || other.x() > kImage.width || other.y() > kImage.height) continue;
    s.p_1.push_back(depth * ray);
    s.px1.push_back(noisy(rng, px, sigma_px));
    s.px2.push_back(noisy(rng, other, sigma_px));
  }
  s.F = fundamental_from_essential(essential_from_pose(s.T_2_1), s.K1, s.K2);
  return s;
}

/// Pairs that have nothing to do with one another.
inline void add_outliers(Rng& rng, int n, TwoViews& s) {
  for (int i = 0; i < n; ++i) {
    for (auto* px : {&s.px1, &s.px2}) {
      const double x = rng.uniform(0, kImage.width - 1);
      px->emplace_back(x, rng.uniform(0, kImage.height - 1));
    }
  }
}

/// RMS symmetric epipolar distance of the noise-free pairs of `truth`.
inline double epipolar_rms(const Mat3& F, const TwoViews& truth) {
  double sum = 0;
  for (const Vec3& p : truth.p_1) {
    const double d = symmetric_epipolar_distance(F, pinhole(truth.K1, p), pinhole(truth.K2, truth.T_2_1 * p));
    sum += d * d;
  }
  return std::sqrt(sum / static_cast<double>(truth.p_1.size()));
}

}  // namespace plumbline::test
