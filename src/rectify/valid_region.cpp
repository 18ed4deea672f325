// SPDX-License-Identifier: Apache-2.0
#include "rectify/valid_region.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include "plumbline/rectify/rectify.hpp"
#include "plumbline/rig/validity.hpp"

namespace plumbline::detail {
namespace {

const double kMaxRadius = std::tan(kMaxHalfAngle_deg * std::numbers::pi / 180);

// The distance from the anchor along unit `direction` at which |q| reaches the cap.
double reach_of_cap(const Vec2& anchor, const Vec2& direction) {
  const double along = anchor.dot(direction);
  return -along + std::sqrt(along * along + kMaxRadius * kMaxRadius - anchor.squaredNorm());
}

}  // namespace

bool RotatedView::sees(const Vec2& q) const {
  if (!(q.norm() <= kMaxRadius * (1 + 1e-12))) return false;
  const auto px = project(*camera, R_new_cam.transpose() * q.homogeneous());
  return px && px->x() >= 0 && px->y() >= 0 && px->x() <= camera->size.width - 1 &&
         px->y() <= camera->size.height - 1;
}

std::vector<Vec2> inner_outline(const RotatedView& view, const Vec2& anchor, int n) {
  std::vector<Vec2> outline;
  if (!view.sees(anchor)) return outline;
  for (int i = 0; i < n; ++i) {
    const double angle = 2 * std::numbers::pi * i / n;
    const Vec2 direction(std::cos(angle), std::sin(angle));
    const double end = reach_of_cap(anchor, direction);
    // Steps that grow, because a plane stretches what is far from its axis; then the exact place by halving.
    constexpr int kSteps = 48;
    double low = 0, high = end;
    int step = 1;
    for (; step <= kSteps; ++step) {
      high = end * step * step / (kSteps * kSteps);
      if (!view.sees(anchor + high * direction)) break;
      low = high;
    }
    for (int k = 0; k < 36 && step <= kSteps; ++k) {
      const double middle = 0.5 * (low + high);
      (view.sees(anchor + middle * direction) ? low : high) = middle;
    }
    outline.push_back(anchor + low * direction);
  }
  return outline;
}

std::vector<Vec2> outer_outline(const RotatedView& view) {
  std::vector<Vec2> outline;
  const double w = view.camera->size.width - 1, h = view.camera->size.height - 1;
  constexpr int kPerSide = 64;
  const auto add = [&](double x, double y) {
    const auto ray = unproject(*view.camera, Vec2(x, y));
    if (!ray) return;
    const Vec3 p = view.R_new_cam * *ray;
    const double radius = p.head<2>().norm();
    if (p.z() > 0 && radius <= kMaxRadius * p.z())
      outline.push_back(p.hnormalized());
    else if (radius > 0)
      outline.push_back(p.head<2>() * (kMaxRadius / radius));
  };
  for (int i = 0; i < kPerSide; ++i) {
    const double s = static_cast<double>(i) / kPerSide;
    add(s * w, 0), add(w, s * h), add((1 - s) * w, h), add(0, (1 - s) * h);
  }
  return outline;
}

double Frame::focal_reaching(const Vec2& q) const {
  double focal = std::numeric_limits<double>::infinity();
  const int extent[2] = {size.width - 1, size.height - 1};
  for (int axis = 0; axis < 2; ++axis) {
    const double d = q[axis] - anchor[axis];
    if (d > 0) focal = std::min(focal, (extent[axis] - anchor_px[axis]) / d);
    if (d < 0) focal = std::min(focal, anchor_px[axis] / -d);
  }
  return focal;
}

double focal_of_valid(const Frame& frame, const std::vector<std::vector<Vec2>>& inner) {
  double focal = 0;
  for (const auto& outline : inner) {
    for (const Vec2& q : outline) focal = std::max(focal, frame.focal_reaching(q));
  }
  return focal;
}

double focal_of_all(const Frame& frame, const std::vector<std::vector<Vec2>>& outer) {
  double focal = std::numeric_limits<double>::infinity();
  for (const auto& outline : outer) {
    for (const Vec2& q : outline) focal = std::min(focal, frame.focal_reaching(q));
  }
  return focal;
}

}  // namespace plumbline::detail
