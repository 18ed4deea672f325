// SPDX-License-Identifier: Apache-2.0
#include <numbers>

#include "plumbline/geometry/so3.hpp"
#include "refine/seed.hpp"

namespace plumbline::detail {

namespace {

std::optional<std::vector<int>> permutation_by(const SE3& T, const std::vector<Vec3>& points,
                                               double tolerance_m) {
  std::vector<int> permutation;
  for (const Vec3& p : points) {
    const Vec3 moved = T * p;
    int match = -1;
    for (std::size_t k = 0; k < points.size() && match < 0; ++k) {
      if ((points[k] - moved).norm() < tolerance_m) match = static_cast<int>(k);
    }
    if (match < 0) return std::nullopt;
    permutation.push_back(match);
  }
  return permutation;
}

}  // namespace

std::vector<Symmetry> symmetries(const Target& target) {
  Symmetry identity;
  for (int i = 0; i < static_cast<int>(target.points.size()); ++i) identity.permutation.push_back(i);
  std::vector<Symmetry> list{identity};
  const auto* chess = std::get_if<Chessboard>(&target.spec);
  const bool circles = std::holds_alternative<Circles>(target.spec);
  if (!chess && !circles) return list;
  Vec3 low = target.points.front(), high = low;
  for (const Vec3& p : target.points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Vec3 middle = 0.5 * (low + high);
  for (int quarter = 1; quarter < 4; ++quarter) {
    // The points alone say nothing about the colours of a board that is not square.
    if (chess && chess->columns != chess->rows && !is_half_turn_symmetric(target.spec)) continue;
    const Mat3 R = so3_exp(Vec3(0, 0, quarter * std::numbers::pi / 2));
    const SE3 T(R, middle - R * middle);
    if (auto permutation = permutation_by(T, target.points, 1e-6 * (high - low).norm())) {
      list.push_back({*std::move(permutation), T});
    }
  }
  return list;
}

}  // namespace plumbline::detail
