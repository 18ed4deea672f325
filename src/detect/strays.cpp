// SPDX-License-Identifier: Apache-2.0
#include "detect/strays.hpp"

#include <algorithm>
#include <cmath>

#include "detect/planar.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline::detail {
namespace {

/// Bounds [px] of the limit for strays. The upper one holds where most corners of a part are wrong and their
/// median says nothing: a part without a rule to go by loses its corners.
constexpr double kStrayFloor = 0.4, kStrayCap = 1.0;
/// Share of a square (tag) that a prediction at the rim of a board may be wrong by itself on a wide lens.
constexpr double kBend = 0.10;

/// The homography that carries places (about the origin) to pixels, by least squares on its linear equations
/// (Hartley and Zisserman 2004, 4.1.2, with w = 1 at the origin); pixels are counted from their mean.
std::optional<Mat3> plane_through(const std::vector<Vec2>& from, const std::vector<Vec2>& to) {
  const std::size_t n = from.size();
  if (n < 4) return std::nullopt;
  Vec2 mean = Vec2::Zero();
  for (const Vec2& p : to) mean += p / static_cast<double>(n);
  double scale = 0;
  for (const Vec2& p : to) scale += (p - mean).norm() / static_cast<double>(n);
  if (!(scale > 0)) return std::nullopt;
  MatX A = MatX::Zero(2 * n, 8);
  VecX b(2 * n);
  for (std::size_t i = 0; i < n; ++i) {
    const Vec2& p = from[i];
    const Vec2 q = (to[i] - mean) / scale;
    A.row(2 * i) << p.x(), p.y(), 1, 0, 0, 0, -p.x() * q.x(), -p.y() * q.x();
    A.row(2 * i + 1) << 0, 0, 0, p.x(), p.y(), 1, -p.x() * q.y(), -p.y() * q.y();
    b.segment<2>(2 * i) = q;
  }
  const auto h = solve_least_squares(A, b);
  if (!h) return std::nullopt;
  Mat3 H;
  H << (*h)(0), (*h)(1), (*h)(2), (*h)(3), (*h)(4), (*h)(5), (*h)(6), (*h)(7), 1;
  Mat3 to_px = Mat3::Identity();
  to_px(0, 0) = to_px(1, 1) = scale;
  to_px.block<2, 1>(0, 2) = mean;
  return Mat3(to_px * H);
}

}  // namespace

std::optional<Prediction> predict(const std::vector<Refined>& all, const Vec2& at, int skip) {
  std::vector<const Refined*> near;
  for (const Refined& r : all)
    if (r.point != skip) near.push_back(&r);
  const std::size_t n = std::min<std::size_t>(near.size(), 16);
  const auto nearer = [&](const Refined* a, const Refined* b) {
    const double da = (a->board - at).squaredNorm(), db = (b->board - at).squaredNorm();
    return da != db ? da < db : a->point < b->point;
  };
  std::partial_sort(near.begin(), near.begin() + static_cast<long>(n), near.end(), nearer);
  std::vector<Vec2> from, to;
  for (std::size_t i = 0; i < n; ++i) {
    from.push_back(near[i]->board - at);
    to.push_back(near[i]->px);
  }
  const auto H = plane_through(from, to);
  const auto px = H ? map_point(*H, Vec2(0, 0)) : std::nullopt;
  if (!px) return std::nullopt;
  Prediction out{*px, map_jacobian(*H, Vec2(0, 0))};
  if (n < 10) return out;
  MatX A(n, 6), rest(n, 2);
  for (std::size_t i = 0; i < n; ++i) {
    const Vec2& p = from[i];
    A.row(i) << 1, p.x(), p.y(), p.x() * p.x(), p.x() * p.y(), p.y() * p.y();
    rest.row(i) = (to[i] - map_point(*H, p).value_or(to[i])).transpose();
  }
  const auto x = solve_least_squares(A, rest.col(0)), y = solve_least_squares(A, rest.col(1));
  if (!x || !y) return out;
  out.px += Vec2((*x)(0), (*y)(0));
  out.J += Mat2{{(*x)(1), (*x)(2)}, {(*y)(1), (*y)(2)}};
  return out;
}

std::vector<Refined> without_strays(std::vector<Refined> corners, double& limit) {
  const auto error_of = [&](const Refined& r) {
    const auto predicted = predict(corners, r.board, r.point);
    if (!predicted) return 1e9;
    const double bend = kBend * std::sqrt(std::abs(predicted->J.determinant()));
    return std::max(0.0, (predicted->px - r.px).norm() - bend);
  };
  std::vector<double> error;
  for (const Refined& r : corners) error.push_back(error_of(r));
  if (limit <= 0 && !error.empty()) {
    std::vector<double> sorted = error;
    std::sort(sorted.begin(), sorted.end());
    limit = std::clamp(6 * sorted[sorted.size() / 2], kStrayFloor, kStrayCap);
  }
  while (true) {
    std::vector<std::size_t> strays;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      bool is_worst_here = error[i] > limit;
      for (std::size_t j = 0; j < corners.size() && is_worst_here; ++j) {
        is_worst_here = error[j] <= error[i] || (corners[j].board - corners[i].board).norm() > 1.5;
      }
      if (is_worst_here) strays.push_back(i);
    }
    if (strays.empty()) return corners;
    std::vector<Vec2> gone;
    for (auto i = strays.rbegin(); i != strays.rend(); ++i) {
      gone.push_back(corners[*i].board);
      corners.erase(corners.begin() + static_cast<long>(*i));
      error.erase(error.begin() + static_cast<long>(*i));
    }
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const auto is_near = [&](const Vec2& p) { return (p - corners[i].board).norm() < 4; };
      if (std::any_of(gone.begin(), gone.end(), is_near)) error[i] = error_of(corners[i]);
    }
  }
}

}  // namespace plumbline::detail
