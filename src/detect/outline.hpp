// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <numbers>

#include "plumbline/core/types.hpp"

namespace plumbline::detail {

/// Area and first moment inside a smooth closed curve by Green's theorem, A = 1/2 oint x dy - y dx, summed
/// over equal steps of its parameter: for a periodic integrand that converges faster than any power of the
/// step (Trefethen & Weideman 2014). Both signs turn with the sense of the curve.
class OutlineSum {
 public:
  explicit OutlineSum(int n_points) : step_(2 * std::numbers::pi / n_points) {}
  /// A point of the curve and its derivative by the parameter, which runs over 2 pi.
  void add(const Vec2& p, const Vec2& d) {
    area_ += step_ * (p.x() * d.y() - p.y() * d.x()) / 2;
    moment_ += step_ * Vec2(p.x() * p.x() * d.y(), -p.y() * p.y() * d.x()) / 2;
  }
  double area() const { return area_; }
  Vec2 centroid() const { return moment_ / area_; }

 private:
  double step_, area_ = 0;
  Vec2 moment_ = Vec2::Zero();
};

}  // namespace plumbline::detail
