// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rig/validity.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "plumbline/core/check.hpp"

namespace plumbline {
namespace {

constexpr double kPi = std::numbers::pi;
// Twice what the eight-fold symmetry of tangential terms needs; a lens whose domain is a disc is done with
// one.
constexpr int kDirections = 32;

Vec3 ray_at(double angle, int direction) {
  const double around = 2 * kPi * direction / kDirections;
  return {std::sin(angle) * std::cos(around), std::sin(angle) * std::sin(around), std::cos(angle)};
}

// By its cosine where that is well conditioned and its sine where it is not.
bool within(const Vec3& p_cam, const Validity& validity) {
  return std::atan2(p_cam.head<2>().norm(), p_cam.z()) <= validity.angle_rad;
}

bool reached(const Lens& lens, const Vec2& px) { return unproject(lens, px).has_value(); }

// Some pixel of the border has no ray.
bool ends_in_image(const Camera& camera) {
  const double w = camera.size.width - 1, h = camera.size.height - 1;
  // The corners first: what ends inside the picture mostly ends there.
  for (const Vec2& px : {Vec2(0, 0), Vec2(w, 0), Vec2(0, h), Vec2(w, h)}) {
    if (!reached(camera.lens, px)) return true;
  }
  constexpr int kPerSide = 16;
  for (int i = 1; i < kPerSide; ++i) {
    const double s = static_cast<double>(i) / kPerSide;
    for (const Vec2& px : {Vec2(s * w, 0), Vec2(s * w, h), Vec2(0, s * h), Vec2(w, s * h)}) {
      if (!reached(camera.lens, px)) return true;
    }
  }
  return false;
}

}  // namespace

std::optional<Vec2> project(const Camera& camera, const Vec3& p_cam, Mat23* J_px_p) {
  if (camera.validity && !within(p_cam, *camera.validity)) return std::nullopt;
  return project(camera.lens, p_cam, J_px_p);
}

std::optional<Vec3> unproject(const Camera& camera, const Vec2& px) {
  auto ray = unproject(camera.lens, px);
  if (ray && camera.validity && !within(*ray, *camera.validity)) return std::nullopt;
  return ray;
}

double domain_angle_rad(const Lens& lens) {
  double least = is_central_perspective(lens) ? 0.5 * kPi : kPi;
  for (int direction = 0; direction < kDirections; ++direction) {
    double low = 0, high = least;
    if (project(lens, ray_at(high * (1 - 1e-9), direction))) continue;
    for (int i = 0; i < 52; ++i) {
      const double middle = 0.5 * (low + high);
      (project(lens, ray_at(middle, direction)) ? low : high) = middle;
    }
    least = low;
  }
  return least;
}

Validity validity_of(const Lens& lens, double angle_rad) {
  PLUMBLINE_CHECK(angle_rad > 0, "the angle of a validity is positive");
  Validity validity{std::min(angle_rad, domain_angle_rad(lens)), std::numeric_limits<double>::infinity()};
  const Vec2 centre(params(lens)[2], params(lens)[3]);
  for (int direction = 0; direction < kDirections; ++direction) {
    const auto px = project(lens, ray_at(validity.angle_rad * (1 - 1e-9), direction));
    if (px) validity.radius_px = std::min(validity.radius_px, (*px - centre).norm());
  }
  if (!std::isfinite(validity.radius_px)) validity.radius_px = 0;
  return validity;
}

double domain_fraction(const Camera& camera) {
  constexpr int kColumns = 40, kRows = 30;
  int n = 0;
  for (int r = 0; r < kRows; ++r) {
    for (int c = 0; c < kColumns; ++c) {
      const Vec2 px(c * (camera.size.width - 1.0) / (kColumns - 1),
                    r * (camera.size.height - 1.0) / (kRows - 1));
      n += unproject(camera, px).has_value();
    }
  }
  return static_cast<double>(n) / (kColumns * kRows);
}

bool folds_in_image(const Camera& camera) {
  if (!ends_in_image(camera)) return false;
  const double widest = is_central_perspective(camera.lens) ? 0.5 * kPi : kPi;
  return domain_angle_rad(camera.lens) < widest * (1 - 1e-6);
}

}  // namespace plumbline
