// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "linear/polynomial_roots.hpp"
#include "plumbline/linear/epipolar.hpp"
#include "plumbline/linear/triangulate.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "triangulation";

// The two epipolar pencils with both pixels at the origin and both epipoles on the x axis, at (1, 0, f1) and
// (1, 0, f2): the line through (0, t, 1) and the first epipole corresponds to [-f2 (c t + d), a t + b, c t +
// d].
struct Pencils {
  double f1, f2, a, b, c, d;

  // Sum of the squared distances of both pixels from their lines.
  double cost(double t) const {
    const double u = a * t + b, v = c * t + d;
    return t * t / (1 + f1 * f1 * t * t) + v * v / (u * u + f2 * f2 * v * v);
  }
  double cost_at_infinity() const { return 1 / (f1 * f1) + c * c / (a * a + f2 * f2 * c * c); }
};

template <std::size_t A, std::size_t B>
std::array<double, A + B - 1> product(const std::array<double, A>& p, const std::array<double, B>& q) {
  std::array<double, A + B - 1> r{};
  for (std::size_t i = 0; i < A; ++i) {
    for (std::size_t j = 0; j < B; ++j) r[i + j] += p[i] * q[j];
  }
  return r;
}

// The numerator of the derivative of the cost, over 2: Hartley & Zisserman 2004, eq. 12.7.
std::array<double, 7> stationary_polynomial(const Pencils& p) {
  const std::array<double, 2> u{p.b, p.a}, v{p.d, p.c};
  const auto uu = product(u, u), vv = product(v, v);
  std::array<double, 3> w;
  for (std::size_t i = 0; i < 3; ++i) w[i] = uu[i] + p.f2 * p.f2 * vv[i];
  const std::array<double, 3> k{1, 0, p.f1 * p.f1};
  const auto first = product(w, w);
  const auto second = product(product(k, k), product(u, v));
  std::array<double, 7> g{};
  for (std::size_t i = 0; i < 5; ++i) g[i + 1] += first[i];
  for (std::size_t i = 0; i < 7; ++i) g[i] -= (p.a * p.d - p.b * p.c) * second[i];
  double largest = 0;
  for (const double x : g) largest = std::max(largest, std::abs(x));
  if (largest > 0) {
    for (double& x : g) x /= largest;
  }
  return g;
}

// The line of the first pencil on which the cost is least, as t = [numerator, denominator].
Vec2 best_line(const Pencils& p) {
  Vec2 best(1, 0);
  double least = p.cost_at_infinity();
  if (!std::isfinite(least)) least = std::numeric_limits<double>::infinity();
  detail::visit_projective_roots<6>(stationary_polynomial(p), [&](double x, double y) {
    const double cost = p.cost(x / y);
    if (!(cost < least)) return;
    least = cost;
    best = Vec2(x, y);
  });
  return best;
}

// The point of a line nearest to the origin.
Vec2 foot(const Vec3& line) { return -line.z() / line.head<2>().squaredNorm() * line.head<2>(); }

}  // namespace

Result<std::pair<Vec2, Vec2>> correct_matches(const Mat3& F_px, const Vec2& px1, const Vec2& px2) {
  const double size = F_px.norm();
  if (!(size > 0) || !F_px.allFinite() || !px1.allFinite() || !px2.allFinite()) {
    return Error{ErrorCode::kInvalidData,
                 "the fundamental matrix is 0, or a number is not finite; check the input", kWhere};
  }
  Mat3 T1 = Mat3::Identity(), T2 = Mat3::Identity();  // from coordinates around the pixels
  T1.topRightCorner<2, 1>() = px1;
  T2.topRightCorner<2, 1>() = px2;
  Mat3 F = T2.transpose() * F_px * T1;
  // The longest cross product of two rows is the right null vector, of two columns the left one.
  Vec3 e1 = F.row(0).cross(F.row(1)).transpose(), e2 = F.col(0).cross(F.col(1));
  for (const auto& [i, j] : {std::pair(0, 2), std::pair(1, 2)}) {
    const Vec3 right = F.row(i).cross(F.row(j)).transpose(), left = F.col(i).cross(F.col(j));
    if (right.squaredNorm() > e1.squaredNorm()) e1 = right;
    if (left.squaredNorm() > e2.squaredNorm()) e2 = left;
  }
  const double l1 = e1.head<2>().norm(), l2 = e2.head<2>().norm();
  // Nearer than 1e-9 px: the direction of the line is rounding.
  if (!(l1 > 1e-9 * e1.norm()) || !(l2 > 1e-9 * e2.norm())) {
    return Error{ErrorCode::kDegenerate,
                 fmt::format("pixel ({:.6g}, {:.6g}) of view {} is at the epipole, where every line is an "
                             "epipolar line: the point is on the line through the two centres; leave it out",
                             l1 > 1e-9 * e1.norm() ? px2.x() : px1.x(),
                             l1 > 1e-9 * e1.norm() ? px2.y() : px1.y(), l1 > 1e-9 * e1.norm() ? 2 : 1),
                 kWhere};
  }
  e1 /= l1, e2 /= l2;
  Mat2 R1, R2;  // rows: towards the epipole, across
  R1 << e1.x(), e1.y(), -e1.y(), e1.x();
  R2 << e2.x(), e2.y(), -e2.y(), e2.x();
  F.leftCols<2>() = (F.leftCols<2>() * R1.transpose()).eval();
  F.topRows<2>() = (R2 * F.topRows<2>()).eval();
  F /= F.bottomRightCorner<2, 2>().cwiseAbs().maxCoeff();
  const Pencils p{e1.z(), e2.z(), F(1, 1), F(1, 2), F(2, 1), F(2, 2)};
  const Vec2 t = best_line(p);
  const double u = p.a * t.x() + p.b * t.y(), v = p.c * t.x() + p.d * t.y();
  const Vec3 line1(t.x() * p.f1, t.y(), -t.x()), line2(-p.f2 * v, u, v);
  return std::pair<Vec2, Vec2>(px1 + R1.transpose() * foot(line1), px2 + R2.transpose() * foot(line2));
}

Result<Vec4> triangulate_optimal(const Mat34& P1, const Mat34& P2, const Vec2& px1, const Vec2& px2) {
  const Mat3 F = fundamental_from_cameras(P1, P2);
  if (F.isZero(0)) {
    return Error{ErrorCode::kDegenerate,
                 "the two views have one centre, so that their rays meet nowhere else; use views that are "
                 "farther apart",
                 kWhere};
  }
  const auto px = correct_matches(F, px1, px2);
  if (!px) return px.error();
  return triangulate_linear(std::array<Mat34, 2>{P1, P2}, std::array<Vec2, 2>{px->first, px->second});
}

}  // namespace plumbline
