// SPDX-License-Identifier: Apache-2.0
#pragma once
/// Random cameras, boards and points with known truth, for the tests of the linear stage.
#include <vector>

#include "plumbline/core/random.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline::test {

inline Vec3 random_vec3(Rng& rng, double low, double high) {
  const double x = rng.uniform(low, high), y = rng.uniform(low, high);
  return {x, y, rng.uniform(low, high)};
}

inline Vec3 random_direction(Rng& rng) {
  const double x = rng.normal(), y = rng.normal();
  return Vec3(x, y, rng.normal()).normalized();
}

/// Any rotation.
inline Mat3 random_rotation(Rng& rng) { return so3_exp(random_direction(rng) * rng.uniform(0, 3.1)); }

/// A camera with its centre somewhere in the middle third of the image.
inline Mat3 random_k(Rng& rng, ImageSize size) {
  Mat3 K = Mat3::Identity();
  K(0, 0) = rng.uniform(0.5, 2.0) * size.width;
  K(1, 1) = K(0, 0) * rng.uniform(0.9, 1.1);
  K(0, 2) = size.width * rng.uniform(0.4, 0.6);
  K(1, 2) = size.height * rng.uniform(0.4, 0.6);
  return K;
}

/// A chessboard's inner corners, centred, z = 0 [m].
inline std::vector<Vec2> grid(int columns, int rows, double square_m) {
  std::vector<Vec2> points;
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      points.emplace_back((c - 0.5 * (columns - 1)) * square_m, (r - 0.5 * (rows - 1)) * square_m);
    }
  }
  return points;
}

inline std::vector<Vec3> on_plane(const std::vector<Vec2>& a) {
  std::vector<Vec3> points;
  for (const Vec2& p : a) points.emplace_back(p.x(), p.y(), 0);
  return points;
}

/// The board at distance_m before the camera, tilted by tilt_rad about a random axis in the image plane and
/// turned in its own plane by any angle.
inline SE3 random_board_pose(Rng& rng, double distance_m, double tilt_rad) {
  const double about = rng.uniform(0, 6.283);
  const Mat3 R =
      so3_exp(tilt_rad * Vec3(std::cos(about), std::sin(about), 0)) * so3_exp(Vec3(0, 0, rng.uniform(-3, 3)));
  const double x = rng.uniform(-0.1, 0.1), y = rng.uniform(-0.1, 0.1);
  return {R, distance_m * Vec3(x, y, 1)};
}

/// Eight corners and six face centres of a box, a solid target [m].
inline std::vector<Vec3> box(double side_m) {
  std::vector<Vec3> points;
  for (int i = 0; i < 8; ++i) points.emplace_back((i & 1) - 0.5, (i >> 1 & 1) - 0.5, (i >> 2 & 1) - 0.5);
  for (int i = 0; i < 3; ++i) {
    points.push_back(0.5 * Vec3::Unit(i));
    points.push_back(-0.5 * Vec3::Unit(i));
  }
  for (Vec3& p : points) p *= side_m;
  return points;
}

inline Vec2 pinhole(const Mat3& K, const Vec3& p_cam) { return (K * p_cam).hnormalized(); }

/// Relative distance of two matrices given up to scale and sign.
template <class A, class B>
double projective_distance(const A& a, const B& b) {
  const double na = a.norm(), nb = b.norm();
  return std::min((a / na - b / nb).norm(), (a / na + b / nb).norm());
}

}  // namespace plumbline::test
