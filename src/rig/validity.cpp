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

// Whether a lens ends at a pole: its image runs off to infinity there, by 1 / (what is left to the end), so
// that each tenth of the way adds ten times as much; one that turns back comes to rest.
bool ends_at_pole(const Lens& lens, double end_rad) {
  constexpr double kLeast_px = 0.1;  // above the rounding of so small a denominator
  const Vec2 centre(params(lens)[2], params(lens)[3]);
  const auto radius_before = [&](double share) {
    double most = 0;
    for (int direction = 0; direction < kDirections; ++direction) {
      const auto px = project(lens, ray_at(end_rad * (1 - share), direction));
      if (px) most = std::max(most, (*px - centre).norm());
    }
    return most;
  };
  const double far = radius_before(1e-9), middle = radius_before(1e-8), near = radius_before(1e-7);
  return far - middle > std::max(kLeast_px, 5 * (middle - near));
}

// Whether at (m, 1) the radius in the image grows with more than the fourth power of the distance from the
// axis on the plane z = 1: s = d log(radius) / d log(distance) is 1 for a pinhole, below 1 for a barrel, at
// most 3 for a cubic pincushion, and 1 + 2 r^2 / (1 - r^2) for a simple pole at the distance 1.
bool is_steep(const Lens& lens, const Vec2& m) {
  constexpr double kSteepest = 4;
  const Vec2 centre(params(lens)[2], params(lens)[3]);
  Mat23 J_px_p;
  const auto px = project(lens, Vec3(m.x(), m.y(), 1), &J_px_p);
  return px && (*px - centre).dot(J_px_p.leftCols<2>() * m) > kSteepest * (*px - centre).squaredNorm();
}

bool is_steep_at(const Lens& lens, const Vec2& px) {
  const auto ray = unproject(lens, px);
  return ray && is_steep(lens, ray->head<2>() / ray->z());
}

// Some pixel of the border `has` it.
template <class Has>
bool somewhere_on_border(const Camera& camera, Has&& has) {
  const double w = camera.size.width - 1, h = camera.size.height - 1;
  // The corners first: what ends inside the picture mostly ends there.
  for (const Vec2& px : {Vec2(0, 0), Vec2(w, 0), Vec2(0, h), Vec2(w, h)}) {
    if (has(px)) return true;
  }
  constexpr int kPerSide = 16;
  for (int i = 1; i < kPerSide; ++i) {
    const double s = static_cast<double>(i) / kPerSide;
    for (const Vec2& px : {Vec2(s * w, 0), Vec2(s * w, h), Vec2(0, s * h), Vec2(w, s * h)}) {
      if (has(px)) return true;
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

Fold fold_of(const Lens& lens) {
  const double end_rad = domain_angle_rad(lens);
  Fold fold{validity_of(lens, end_rad), is_central_perspective(lens) && ends_at_pole(lens, end_rad)};
  if (!fold.is_pole) return fold;
  constexpr int kSteps = 1000;
  for (int i = 1; i < kSteps; ++i) {
    const double distance = std::tan(end_rad) * i / kSteps;
    for (int direction = 0; direction < kDirections; ++direction) {
      const double around = 2 * kPi * direction / kDirections;
      if (!is_steep(lens, distance * Vec2(std::cos(around), std::sin(around)))) continue;
      fold.end = validity_of(lens, std::atan(distance));
      return fold;
    }
  }
  fold.end = validity_of(lens, std::atan(std::tan(end_rad) * (kSteps - 1) / kSteps));
  return fold;
}

bool folds_in_image(const Camera& camera) {
  const Lens& lens = camera.lens;
  const bool forward = is_central_perspective(lens);
  const bool ends = somewhere_on_border(camera, [&](const Vec2& px) { return !reached(lens, px); });
  if (!ends && !forward) return false;
  const double end_rad = domain_angle_rad(lens);
  if (!(end_rad < (forward ? 0.5 * kPi : kPi) * (1 - 1e-6))) return false;
  // On the way to a pole the image covers all pixels, so that each has a ray, in a rim of no width.
  return ends || (ends_at_pole(lens, end_rad) &&
                  somewhere_on_border(camera, [&](const Vec2& px) { return is_steep_at(lens, px); }));
}

}  // namespace plumbline
