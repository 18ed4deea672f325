// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <numbers>

#include "plumbline/lens/lens.hpp"

namespace plumbline {
namespace {

using Mat32 = Eigen::Matrix<double, 3, 2>;

// A chart of the directions that a lens may see, two numbers with the optical axis at (0, 0). A lens that
// looks forward only: the plane z = 1, where a ray near 90 degrees keeps all its digits. A lens that sees
// behind itself: the vector of length theta that points theta radians from the axis, which covers all but the
// one straight back.
template <class L>
Vec3 ray_of(const Vec2& chart, Mat32* J = nullptr) {
  if constexpr (L::kIsCentralPerspective) {
    if (J) *J << 1, 0, 0, 1, 0, 0;
    return {chart.x(), chart.y(), 1};
  } else {
    const double t = chart.norm(), t2 = t * t;
    const double s = t < 1e-4 ? 1 - t2 / 6 : std::sin(t) / t;                  // sin(t)/t
    const double ds = t < 1e-2 ? -1.0 / 3 + t2 / 30 : (std::cos(t) - s) / t2;  // (d s/d t) / t
    if (J) {
      *J << s + ds * chart.x() * chart.x(), ds * chart.x() * chart.y(), ds * chart.x() * chart.y(),
          s + ds * chart.y() * chart.y(), -s * chart.x(), -s * chart.y();
    }
    return {s * chart.x(), s * chart.y(), std::cos(t)};
  }
}

// The chart point along `direction` that projects as far from the centre as px, tangential terms left out of
// account: bisection, which a lens that folds back cannot fool, because its domain ends there.
template <class L>
Vec2 radial_start(const L& lens, const Vec2& direction, const Vec2& px, const Vec2& centre_px) {
  const auto radius = [](double angle) { return L::kIsCentralPerspective ? std::tan(angle) : angle; };
  double low = 0, high = L::kIsCentralPerspective ? std::numbers::pi / 2 : std::numbers::pi;
  const double wanted = (px - centre_px).norm();
  for (int i = 0; i < 40; ++i) {
    const double middle = 0.5 * (low + high);
    const auto q = lens.project(ray_of<L>(radius(middle) * direction));
    if (!q || (*q - centre_px).norm() > wanted) {
      high = middle;
    } else {
      low = middle;
    }
  }
  return radius(low) * direction;
}

// A step on the chart: turned by its part across the radius, lengthened by its part along it. To first order
// that is the sum, but near the edge of a strong lens, where the image hardly depends on anything but the
// radius, a straight step sideways would move outward and land far away.
Vec2 moved(const Vec2& chart, const Vec2& step) {
  const double r = chart.norm();
  if (step.norm() > 0.5 * r) return chart + step;
  const Vec2 out = chart / r, across(-out.y(), out.x());
  const double turn = across.dot(step) / r;
  return (r + out.dot(step)) * (std::cos(turn) * out + std::sin(turn) * across);
}

// Newton's method with halved steps where a full one leaves the domain or does not come nearer.
template <class L>
std::optional<Vec3> newton(const L& lens, const Vec2& px, Vec2 chart) {
  Mat32 J_ray_chart;
  Mat23 J_px_ray;
  auto q = lens.project(ray_of<L>(chart, &J_ray_chart), &J_px_ray);
  if (!q) return std::nullopt;
  double error_px = (px - *q).norm();
  const double scale_px = 1 + px.norm();
  for (int i = 0; i < 50 && error_px > 1e-15 * scale_px; ++i) {
    const Mat2 J = J_px_ray * J_ray_chart;
    Vec2 step = J.inverse() * (px - *q);
    if (!step.allFinite()) break;
    bool better = false;
    const int trials = error_px < 1e-9 * scale_px ? 1 : 12;  // so near, a step that does not help is rounding
    for (int trial_index = 0; trial_index < trials && !better; ++trial_index, step *= 0.5) {
      Mat32 J_trial_chart;
      Mat23 J_trial;
      const Vec2 trial = moved(chart, step);
      if (!L::kIsCentralPerspective && trial.norm() >= std::numbers::pi)
        continue;  // once around: another ray
      const auto trial_px = lens.project(ray_of<L>(trial, &J_trial_chart), &J_trial);
      if (!trial_px || !((px - *trial_px).norm() < error_px)) continue;
      chart = trial, q = trial_px, J_px_ray = J_trial, J_ray_chart = J_trial_chart;
      error_px = (px - *q).norm();
      better = true;
    }
    if (!better) break;
  }
  if (!(error_px < 1e-10 + 1e-13 * scale_px)) return std::nullopt;
  return ray_of<L>(chart).normalized();
}

// Newton's method from radial starts: along `direction` first, then turned by what the tangential terms
// turned the image, which near a fold decides whether Newton's method arrives.
template <class L>
std::optional<Vec3> from_radial_starts(const L& lens, const Vec2& px, Vec2 direction, const Vec2& centre_px) {
  for (int turn = 0; turn < 4; ++turn) {
    const Vec2 start = radial_start(lens, direction, px, centre_px);
    if (const auto ray = newton(lens, px, start)) return ray;
    const auto landed = lens.project(ray_of<L>(start));
    if (!landed) break;
    const Vec2 scale(1 / lens.fx, 1 / lens.fy), a = (*landed - centre_px).cwiseProduct(scale),
                                                b = (px - centre_px).cwiseProduct(scale);
    const double angle = std::atan2(a.x() * b.y() - a.y() * b.x(), a.dot(b));
    if (!(std::abs(angle) > 1e-12)) break;
    direction = Vec2(std::cos(angle) * direction.x() - std::sin(angle) * direction.y(),
                     std::sin(angle) * direction.x() + std::cos(angle) * direction.y());
  }
  return std::nullopt;
}

template <class L>
std::optional<Vec3> unproject_by_newton(const L& l, const Vec2& px) {
  const Vec2 centre_px(l.cx, l.cy), m((px.x() - l.cx) / l.fx, (px.y() - l.cy) / l.fy);
  const double radius = m.norm();
  const Vec2 direction = radius > 0 ? Vec2(m / radius) : Vec2(1, 0);
  // The undistorted position is right or close for most lenses; the bisection catches the rest.
  const Vec2 start = L::kIsCentralPerspective ? m : Vec2(std::fmin(radius, 3.0) * direction);
  if (const auto ray = newton(l, px, start)) return ray;
  return from_radial_starts(l, px, direction, centre_px);
}

}  // namespace

std::optional<Vec3> unproject(const Lens& lens, const Vec2& px) {
  if (!px.allFinite()) return std::nullopt;
  return std::visit(
      [&]<class L>(const L& l) -> std::optional<Vec3> {
        if constexpr (CountedLens<L>)
          return l.unproject(px);
        else
          return unproject_by_newton(l, px);
      },
      lens);
}

}  // namespace plumbline
