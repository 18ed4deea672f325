// SPDX-License-Identifier: Apache-2.0
#include "plumbline/target/bow.hpp"

namespace plumbline {

std::optional<Outline> outline_of(const std::vector<Vec3>& points) {
  if (points.empty()) return std::nullopt;
  Vec3 low = points[0], high = points[0];
  for (const Vec3& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Vec2 extent = (high - low).head<2>();
  const bool flat = low.cwiseMin(-high).z() >= -1e-9 * extent.norm();
  if (!flat || !(extent.minCoeff() > 0)) return std::nullopt;
  return Outline{low.head<2>(), high.head<2>()};
}

Vec2 bow_shape(const Outline& outline, const Vec3& p_board) {
  const Vec2 q =
      (2 * p_board.head<2>() - outline.low - outline.high).cwiseQuotient(outline.high - outline.low);
  return Vec2::Ones() - q.cwiseProduct(q);
}

}  // namespace plumbline
