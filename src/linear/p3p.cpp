// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/p3p.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace plumbline {
namespace {

// Below this sine of the angle at a corner (or cosine's distance from 1 between two rays) three points count
// as collinear: the orientation about their line would be known to 1e-16 / 1e-7 at best.
constexpr double kFlat = 1e-7;
// What is left of the quadrics, over the longest side squared, at a pose that solves them. Rounding leaves
// 1e-15 times (distance / side)^2; a step of Newton's method that stalls at a double root leaves the square
// of 1e-8.
constexpr double kSolved = 1e-11;

// The triangle and its rays: squared sides (23 is the longest and 1) and cosines between the rays.
struct Triangle {
  double a12, a13;
  double b12, b13, b23;
};

// The root of c3 x^3 + c2 x^2 + c1 x + c0 that lies farthest from the cubic's point of symmetry: a simple
// root, however close together the other two are. \pre c3 != 0
double outer_root(double c3, double c2, double c1, double c0) {
  const double b = c2 / c3, c = c1 / c3, d = c0 / c3;
  // x = y - b/3:  y^3 + p y + q
  const double p = c - b * b / 3, q = (2 * b * b / 27 - c / 3) * b + d;
  double y;
  if (p < 0) {
    const double m = std::sqrt(-p / 3), h = 0.5 * q / (m * m * m);
    // y = -2 m sign(q) cosh(acosh|h| / 3), or cos and acos: the outer root, of the sign opposite to q
    const double k =
        std::abs(h) <= 1 ? std::cos(std::acos(std::abs(h)) / 3) : std::cosh(std::acosh(std::abs(h)) / 3);
    y = q > 0 ? -2 * m * k : 2 * m * k;
  } else {
    const double r = std::sqrt(0.25 * q * q + p * p * p / 27), s = std::cbrt(0.5 * std::abs(q) + r);
    y = s > 0 ? s - p / (3 * s) : 0.0;
    if (q > 0) y = -y;
  }
  double x = y - b / 3;
  for (int i = 0; i < 2; ++i) {
    const double slope = (3 * x + 2 * b) * x + c;
    if (slope == 0) break;
    x -= (((x + b) * x + c) * x + d) / slope;
  }
  return x;
}

Mat3 adjugate(const Mat3& A) {  // of a symmetric matrix
  Mat3 B;
  B(0, 0) = A(1, 1) * A(2, 2) - A(1, 2) * A(1, 2);
  B(1, 1) = A(0, 0) * A(2, 2) - A(0, 2) * A(0, 2);
  B(2, 2) = A(0, 0) * A(1, 1) - A(0, 1) * A(0, 1);
  B(0, 1) = B(1, 0) = A(0, 2) * A(1, 2) - A(0, 1) * A(2, 2);
  B(0, 2) = B(2, 0) = A(0, 1) * A(1, 2) - A(0, 2) * A(1, 1);
  B(1, 2) = B(2, 1) = A(0, 2) * A(0, 1) - A(0, 0) * A(1, 2);
  return B;
}

// A root of det(x D1 + y D2) = 0 as [x, y].
Vec2 degenerate_member(const Mat3& D1, const Mat3& D2) {
  const Mat3 A1 = adjugate(D1), A2 = adjugate(D2);
  // det(D1 + g D2) = c0 + c1 g + c2 g^2 + c3 g^3
  const double c0 = A1.col(0).dot(D1.col(0)), c3 = A2.col(0).dot(D2.col(0));
  const double c1 = A1.cwiseProduct(D2).sum(), c2 = A2.cwiseProduct(D1).sum();
  if (std::abs(c3) >= std::abs(c0)) return c3 != 0 ? Vec2(1, outer_root(c3, c2, c1, c0)) : Vec2(1, 0);
  return {outer_root(c0, c1, c2, c3), 1};
}

// The two lines of a degenerate conic, p q' + q p' ~ D; nullopt when they are complex.
std::optional<std::pair<Vec3, Vec3>> split_lines(const Mat3& D) {
  const Mat3 B = -adjugate(D);  // = (p x q)(p x q)'
  int k;
  const double largest = B.diagonal().maxCoeff(&k);
  Mat3 C = D;
  if (largest > 0) {
    const Vec3 v = B.col(k) / std::sqrt(largest);
    C(0, 1) -= v.z(), C(1, 0) += v.z();
    C(0, 2) += v.y(), C(2, 0) -= v.y();
    C(1, 2) -= v.x(), C(2, 1) += v.x();
  } else if (B.trace() < -1e-12 * D.squaredNorm()) {
    return std::nullopt;
  }  // between the two: one line twice, as far as rounding tells
  int row, col;
  if (!(C.cwiseAbs().maxCoeff(&row, &col) > 0)) return std::nullopt;
  return std::pair<Vec3, Vec3>(C.col(col), C.row(row).transpose());
}

// Where the line n'l = 0 meets the conic l'Dl = 0, as directions: both, or none when they are complex.
int intersect(const Vec3& n, const Mat3& D, Vec3* out) {
  int i;
  n.cwiseAbs().maxCoeff(&i);
  const int j = (i + 1) % 3, k = (i + 2) % 3;
  Vec3 u = Vec3::Unit(j), v = Vec3::Unit(k);
  u[i] = -n[j] / n[i];
  v[i] = -n[k] / n[i];
  const Vec3 Du = D * u, Dv = D * v;
  const double a = u.dot(Du), b = u.dot(Dv), c = v.dot(Dv);  // a s^2 + 2 b s t + c t^2
  const double discriminant = b * b - a * c;
  // Slightly negative by rounding where both intersections meet: the double root then.
  if (discriminant < -1e-10 * (b * b + std::abs(a * c))) return 0;
  const double root = std::sqrt(std::max(discriminant, 0.0)), q = -(b + (b < 0 ? -root : root));
  out[0] = q * u + a * v;  // s / t = q / a
  out[1] = c * u + q * v;  // s / t = c / q
  return 2;
}

Vec3 quadrics(const Triangle& t, const Vec3& l) {
  return {l[0] * l[0] + l[1] * l[1] - 2 * t.b12 * l[0] * l[1] - t.a12,
          l[0] * l[0] + l[2] * l[2] - 2 * t.b13 * l[0] * l[2] - t.a13,
          l[1] * l[1] + l[2] * l[2] - 2 * t.b23 * l[1] * l[2] - 1};
}

// Newton's method on the quadrics, as long as it comes nearer; whether it arrives.
bool polish(const Triangle& t, Vec3& l) {
  Vec3 r = quadrics(t, l);
  double error = r.cwiseAbs().maxCoeff();
  for (int i = 0; i < 8 && error > 0; ++i) {
    // Halves of the derivatives: rows [u12 v12 0], [u13 0 v13], [0 u23 v23]
    const double u12 = l[0] - t.b12 * l[1], v12 = l[1] - t.b12 * l[0];
    const double u13 = l[0] - t.b13 * l[2], v13 = l[2] - t.b13 * l[0];
    const double u23 = l[1] - t.b23 * l[2], v23 = l[2] - t.b23 * l[1];
    const double det = -u12 * v13 * u23 - v12 * u13 * v23;
    if (det == 0) break;
    const double k = 0.5 / det;
    const Vec3 step(k * (-v13 * u23 * r[0] - v12 * v23 * r[1] + v12 * v13 * r[2]),
                    k * (-u13 * v23 * r[0] + u12 * v23 * r[1] - u12 * v13 * r[2]),
                    k * (u13 * u23 * r[0] - u12 * u23 * r[1] - v12 * u13 * r[2]));
    const Vec3 next = l - step, next_r = quadrics(t, next);
    const double next_error = next_r.cwiseAbs().maxCoeff();
    if (!(next_error < error)) break;
    l = next, r = next_r;
    const bool rounding = error < 1e-13;  // one step from here doubles the digits that are left
    error = next_error;
    if (rounding) break;
  }
  return error < kSolved * std::max(1.0, l.squaredNorm()) && l.minCoeff() > 0;
}

// Distances along the rays that solve the quadrics to a few digits: up to four, into `l`.
int starts(const Triangle& t, Vec3* l) {
  // quadric 12 - a12 quadric 23 and quadric 13 - a13 quadric 23: no constant terms.
  Mat3 D1, D2;
  D1 << 1, -t.b12, 0, -t.b12, 1 - t.a12, t.a12 * t.b23, 0, t.a12 * t.b23, -t.a12;
  D2 << 1, 0, -t.b13, 0, -t.a13, t.a13 * t.b23, -t.b13, t.a13 * t.b23, 1 - t.a13;
  const Vec2 g = degenerate_member(D1, D2);
  const auto lines = split_lines(g.x() * D1 + g.y() * D2);
  if (!lines) return 0;
  // The member of the pencil that is less like the pair of lines cuts them more sharply.
  const Mat3& D = std::abs(g.y()) > std::abs(g.x()) ? D1 : D2;
  Vec3 directions[4];
  int n_directions = intersect(lines->first, D, directions);
  n_directions += intersect(lines->second, D, directions + n_directions);
  int n = 0;
  for (int i = 0; i < n_directions; ++i) {
    const Vec3& d = directions[i];
    // Its length from the sum of the quadrics.
    const double form =
        2 * (d.squaredNorm() - t.b12 * d[0] * d[1] - t.b13 * d[0] * d[2] - t.b23 * d[1] * d[2]);
    if (!(form > 0)) continue;
    l[n] = d * ((d.sum() < 0 ? -1 : 1) * std::sqrt((t.a12 + t.a13 + 1) / form));
    if (l[n].minCoeff() > -1e-6 * l[n].maxCoeff())
      ++n;  // the polish decides about one at the camera's centre
  }
  return n;
}

// The right-handed frame of a triangle: first axis along 1 -> 2, third across it.
Mat3 frame(const Vec3& p12, const Vec3& p13) {
  Mat3 F;
  F.col(0) = p12.normalized();
  F.col(2) = p12.cross(p13).normalized();
  F.col(1) = F.col(2).cross(F.col(0));
  return F;
}

}  // namespace

P3pSolutions p3p(std::span<const Vec3, 3> p_world, std::span<const Vec3, 3> rays_cam) {
  P3pSolutions solutions;
  // The longest side becomes the side 23: the differences of the quadrics are then least alike.
  std::size_t first = 0;
  double longest = -1;
  for (std::size_t i = 0; i < 3; ++i) {
    const double a = (p_world[(i + 1) % 3] - p_world[(i + 2) % 3]).squaredNorm();
    if (a > longest) first = i, longest = a;
  }
  const Vec3& p1 = p_world[first];
  const Vec3 &r1 = rays_cam[first], &r2 = rays_cam[(first + 1) % 3], &r3 = rays_cam[(first + 2) % 3];
  const Vec3 p12 = p_world[(first + 1) % 3] - p1, p13 = p_world[(first + 2) % 3] - p1;
  if (!(p12.cross(p13).norm() > kFlat * longest) || !std::isfinite(longest)) return solutions;
  const Triangle t{p12.squaredNorm() / longest, p13.squaredNorm() / longest, r1.dot(r2), r1.dot(r3),
                   r2.dot(r3)};
  Vec3 l[4];
  const int n = starts(t, l);
  const double side = std::sqrt(longest);
  const Mat3 F_world = frame(p12, p13);
  for (int i = 0; i < n; ++i) {
    if (!polish(t, l[i]) || std::find(l, l + i, l[i]) != l + i) continue;
    const Vec3 q1 = l[i][0] * r1, q2 = l[i][1] * r2, q3 = l[i][2] * r3;
    const Mat3 R = frame(q2 - q1, q3 - q1) * F_world.transpose();
    if (!R.allFinite()) continue;
    // The centroid, so that no corner is nearer the truth than another.
    solutions.push_back(SE3(R, side / 3 * (q1 + q2 + q3) - R * (p1 + (p12 + p13) / 3)));
  }
  return solutions;
}

}  // namespace plumbline
