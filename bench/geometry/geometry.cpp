// SPDX-License-Identifier: Apache-2.0
#include "geometry/geometry.hpp"

#include <cmath>
#include <numbers>

#include "plumbline/geometry/so3.hpp"

namespace plumbline::bench {

Vec2 noisy(Rng& rng, const Vec2& px, double sigma) {
  const double dx = rng.normal(sigma);
  return px + Vec2(dx, rng.normal(sigma));
}

Vec2 random_pixel(Rng& rng) {
  const double x = rng.uniform(0, kSize.width - 1);
  return {x, rng.uniform(0, kSize.height - 1)};
}

bool in_image(const Vec2& px) {
  return px.x() >= 0 && px.y() >= 0 && px.x() <= kSize.width - 1 && px.y() <= kSize.height - 1;
}

Mat3 random_k(Rng& rng) {
  Mat3 K = Mat3::Identity();
  K(0, 0) = K(1, 1) = rng.uniform(700, 1400);
  K(0, 2) = rng.uniform(600, 680);
  K(1, 2) = rng.uniform(440, 520);
  return K;
}

cv::Matx33d to_cv(const Mat3& M) {
  cv::Matx33d out;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) out(r, c) = M(r, c);
  return out;
}

Mat3 to_mat3(const cv::Mat& M) {
  Mat3 out;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) out(r, c) = M.at<double>(r, c);
  return out;
}

double angle_deg(const Mat3& R) { return rotation_angle(R) * 180 / std::numbers::pi; }

double angle_deg(const Vec3& a, const Vec3& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180 / std::numbers::pi;
}

}  // namespace plumbline::bench
