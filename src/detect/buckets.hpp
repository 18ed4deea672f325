// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <cmath>
#include <vector>

#include "detect/saddles.hpp"

namespace plumbline::detail {

/// Saddles by place.
class Buckets {
 public:
  /// Keeps a reference to the list.
  explicit Buckets(const std::vector<Saddle>& saddles) : saddles_(saddles) {
    for (const Saddle& s : saddles) size_ = size_.cwiseMax(s.px);
    const double area = (size_.x() + 1) * (size_.y() + 1);
    pitch_ = std::max(4.0, std::sqrt(area / std::max<double>(1, static_cast<double>(saddles.size()))));
    nx_ = static_cast<int>(size_.x() / pitch_) + 1;
    ny_ = static_cast<int>(size_.y() / pitch_) + 1;
    cells_.resize(static_cast<std::size_t>(nx_) * ny_);
    for (std::size_t i = 0; i < saddles.size(); ++i)
      cells_[cell(saddles[i].px)].push_back(static_cast<int>(i));
  }

  /// Calls visit(index) for the saddles within `radius` of p.
  template <class Visit>
  void within(const Vec2& p, double radius, const Visit& visit) const {
    const int x0 = column(p.x() - radius, nx_), x1 = column(p.x() + radius, nx_);
    const int y0 = column(p.y() - radius, ny_), y1 = column(p.y() + radius, ny_);
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        for (const int i : cells_[static_cast<std::size_t>(y) * nx_ + x]) {
          if ((saddles_[static_cast<std::size_t>(i)].px - p).squaredNorm() <= radius * radius) visit(i);
        }
      }
    }
  }

  /// The same for the saddles near the box between two points.
  template <class Visit>
  void between(const Vec2& a, const Vec2& b, const Visit& visit) const {
    const Vec2 low = a.cwiseMin(b), high = a.cwiseMax(b);
    const int x0 = column(low.x(), nx_), x1 = column(high.x(), nx_);
    const int y0 = column(low.y(), ny_), y1 = column(high.y(), ny_);
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        for (const int i : cells_[static_cast<std::size_t>(y) * nx_ + x]) visit(i);
      }
    }
  }

  /// Mean distance of neighbours [px].
  double pitch() const { return pitch_; }
  double extent() const { return std::max(size_.x(), size_.y()); }

 private:
  int column(double v, int n) const { return std::clamp(static_cast<int>(v / pitch_), 0, n - 1); }
  std::size_t cell(const Vec2& p) const {
    return static_cast<std::size_t>(column(p.y(), ny_)) * nx_ + column(p.x(), nx_);
  }
  const std::vector<Saddle>& saddles_;
  Vec2 size_ = Vec2::Zero();
  double pitch_ = 1;
  int nx_ = 1, ny_ = 1;
  std::vector<std::vector<int>> cells_;
};

}  // namespace plumbline::detail
