// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <numbers>

#include "plumbline/lens/lens.hpp"

namespace plumbline {
namespace {

// A chart of the unit sphere around the optical axis: the vector (a, b) of length theta points theta radians
// from the axis. It covers every direction but the one straight back, so that one Newton iteration serves
// every lens.
Vec3 ray_of(const Vec2& chart, Eigen::Matrix<double, 3, 2>* J = nullptr) {
  const double t = chart.norm(), t2 = t * t;
  const double s = t < 1e-4 ? 1 - t2 / 6 : std::sin(t) / t;                  // sin(t)/t
  const double ds = t < 1e-2 ? -1.0 / 3 + t2 / 30 : (std::cos(t) - s) / t2;  // (d s/d t) / t
  if (J) {
    *J << s + ds * chart.x() * chart.x(), ds * chart.x() * chart.y(), ds * chart.x() * chart.y(),
        s + ds * chart.y() * chart.y(), -s * chart.x(), -s * chart.y();
  }
  return {s * chart.x(), s * chart.y(), std::cos(t)};
}

// The chart point along `direction` whose image is `radius_px`-most: radial bisection, the tangential terms
// left out of account. It cannot be fooled by a lens that folds back, because the domain ends there.
Vec2 radial_start(const Lens& lens, const Vec2& direction, const Vec2& px, const Vec2& centre_px) {
  double low = 0, high = is_central_perspective(lens) ? std::numbers::pi / 2 : std::numbers::pi;
  const double wanted = (px - centre_px).norm();
  for (int i = 0; i < 40; ++i) {
    const double middle = 0.5 * (low + high);
    const auto q = project(lens, ray_of(middle * direction));
    if (!q || (*q - centre_px).norm() > wanted)
      high = middle;
    else
      low = middle;
  }
  return low * direction;
}

std::optional<Vec3> newton(const Lens& lens, const Vec2& px, Vec2 chart) {
  Eigen::Matrix<double, 3, 2> J_ray_chart;
  Mat23 J_px_ray;
  auto q = project(lens, ray_of(chart, &J_ray_chart), &J_px_ray);
  if (!q) return std::nullopt;
  double error_px = (px - *q).norm();
  const double good_px = 1e-13 * (1 + px.norm());  // rounding of the projection itself
  for (int i = 0; i < 50 && error_px > good_px; ++i) {
    const Mat2 J = J_px_ray * J_ray_chart;
    Vec2 step = J.inverse() * (px - *q);
    if (!step.allFinite()) break;
    bool better = false;
    for (int halving = 0; halving < 12 && !better; ++halving, step *= 0.5) {
      Eigen::Matrix<double, 3, 2> J_trial_chart;
      Mat23 J_trial;
      const Vec2 trial = chart + step;
      if (trial.norm() >= std::numbers::pi) continue;
      const auto trial_px = project(lens, ray_of(trial, &J_trial_chart), &J_trial);
      if (!trial_px || !((px - *trial_px).norm() < error_px)) continue;
      chart = trial, q = trial_px, J_px_ray = J_trial, J_ray_chart = J_trial_chart;
      error_px = (px - *q).norm();
      better = true;
    }
    if (!better) break;
  }
  if (!(error_px < 1e-10 * (1 + 1e-3 * px.norm()))) return std::nullopt;
  return ray_of(chart).normalized();
}

}  // namespace

std::optional<Vec3> unproject(const Lens& lens, const Vec2& px) {
  if (!px.allFinite()) return std::nullopt;
  const std::span<const double> k = params(lens);
  const Vec2 centre_px(k[2], k[3]), m((px.x() - k[2]) / k[0], (px.y() - k[3]) / k[1]);
  const double radius = m.norm();
  if (radius == 0) {
    if (const auto ray = newton(lens, px, Vec2::Zero())) return ray;
  }
  // The undistorted position is right or close for most lenses; the bisection catches the rest.
  const double theta = is_central_perspective(lens) ? std::atan(radius) : std::min(radius, 3.0);
  const Vec2 direction = radius > 0 ? Vec2(m / radius) : Vec2(1, 0);
  if (const auto ray = newton(lens, px, theta * direction)) return ray;
  return newton(lens, px, radial_start(lens, direction, px, centre_px));
}

}  // namespace plumbline
