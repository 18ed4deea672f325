// SPDX-License-Identifier: Apache-2.0
#include "plumbline/lens/splined.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "plumbline/core/check.hpp"
#include "plumbline/core/text.hpp"

namespace plumbline {
namespace {

constexpr double kDeg = std::numbers::pi / 180;

// The B-splines that are not zero at position i of a row of n knots: the first of them, and their values and
// slopes along i. Uniform B-splines of order 2 and 3 (de Boor, A Practical Guide to Splines, 1978).
struct Basis {
  int first = 0;
  std::array<double, 4> value{}, slope{};
};

int first_knot(int order, int n, double i) {
  if (order == 2) return std::clamp(static_cast<int>(std::floor(i + 0.5)), 1, n - 2) - 1;
  return std::clamp(static_cast<int>(std::floor(i)), 1, n - 3) - 1;
}

Basis basis_at(int order, int n, double i) {
  Basis b;
  b.first = first_knot(order, n, i);
  if (order == 2) {
    const double x = i - (b.first + 1);  // -1/2 to 1/2
    b.value = {0.5 * (0.5 - x) * (0.5 - x), 0.75 - x * x, 0.5 * (0.5 + x) * (0.5 + x), 0};
    b.slope = {x - 0.5, -2 * x, x + 0.5, 0};
  } else {
    const double x = i - (b.first + 1), y = 1 - x;  // 0 to 1
    b.value = {y * y * y / 6, 2.0 / 3 - x * x * (1 - 0.5 * x), 2.0 / 3 - y * y * (1 - 0.5 * y),
               x * x * x / 6};
    b.slope = {-0.5 * y * y, x * (1.5 * x - 2), y * (2 - 1.5 * y), 0.5 * x * x};
  }
  return b;
}

// The correction at u, its Jacobian, and the splines it is made of.
struct Correction {
  Vec2 c = Vec2::Zero();
  Mat2 J_c_u = Mat2::Zero();
  Basis x, y;
};

bool within_reach(const Splined& lens, const Vec2& u) {
  const Vec2 reach = lens.reach();
  return std::abs(u.x()) <= reach.x() && std::abs(u.y()) <= reach.y();
}

std::optional<Correction> correction_at(const Splined& lens, const Vec2& u) {
  if (!within_reach(lens, u)) return std::nullopt;
  const double s = lens.knots_per_unit();
  Correction at;
  at.x = basis_at(lens.order, lens.n_x, u.x() * s + 0.5 * (lens.n_x - 1));
  at.y = basis_at(lens.order, lens.n_y, u.y() * s + 0.5 * (lens.n_y - 1));
  for (int j = 0; j <= lens.order; ++j) {
    const double* row = &lens.k[static_cast<std::size_t>(lens.control_point(at.x.first, at.y.first + j))];
    Vec2 value = Vec2::Zero(), slope = Vec2::Zero();
    for (int i = 0; i <= lens.order; ++i) {
      const Vec2 c(row[2 * i], row[2 * i + 1]);
      value += at.x.value[i] * c;
      slope += at.x.slope[i] * c;
    }
    at.c += at.y.value[j] * value;
    at.J_c_u.col(0) += s * at.y.value[j] * slope;
    at.J_c_u.col(1) += s * at.y.slope[j] * value;
  }
  return at;
}

// m = u + c(u) and d(m)/d(u); nullopt outside the domain.
struct Mapped {
  Vec2 m;
  Mat2 J_m_u;
};

std::optional<Mapped> mapped(const Splined& lens, const Vec2& u) {
  const auto at = correction_at(lens, u);
  if (!at) return std::nullopt;
  const Mapped result{u + at->c, Mat2::Identity() + at->J_c_u};
  if (!(result.J_m_u.determinant() > 0) || !std::isfinite(result.m.sum())) return std::nullopt;
  return result;
}

// Newton's method on u, with halved steps where a full one leaves the domain or comes no nearer.
std::optional<Vec2> newton(const Splined& lens, const Vec2& m, Vec2 u, double tolerance) {
  const Vec2 reach = lens.reach();
  u = u.cwiseMin(reach).cwiseMax(-reach);
  auto at = mapped(lens, u);
  if (!at) return std::nullopt;
  double error = (m - at->m).norm();
  for (int i = 0; i < 50 && error > 1e-16; ++i) {
    Vec2 step = at->J_m_u.inverse() * (m - at->m);
    if (!step.allFinite()) break;
    bool better = false;
    const int trials = error < 100 * tolerance ? 1 : 12;
    for (int trial = 0; trial < trials && !better; ++trial, step *= 0.5) {
      const Vec2 next = (u + step).cwiseMin(reach).cwiseMax(-reach);
      const auto there = mapped(lens, next);
      if (!there || !((m - there->m).norm() < error)) continue;
      u = next, at = there, error = (m - there->m).norm();
      better = true;
    }
    if (!better) break;
  }
  if (!(error < tolerance)) return std::nullopt;
  return u;
}

// The knot whose image is nearest.
Vec2 nearest_knot(const Splined& lens, const Vec2& m) {
  Vec2 best = Vec2::Zero();
  double least = std::numeric_limits<double>::infinity();
  for (int j = 0; j < lens.n_y; ++j) {
    for (int i = 0; i < lens.n_x; ++i) {
      const Vec2 u = lens.knot(i, j);
      const auto at = mapped(lens, u);
      if (!at || !((at->m - m).norm() < least)) continue;
      least = (at->m - m).norm();
      best = u;
    }
  }
  return best;
}

Error bad_options(std::string_view options, std::string what) {
  return {ErrorCode::kInvalidData,
          fmt::format("splined:{}: {}; NXxNY:FOV_X_DEG[:ORDER] is needed, such as splined:30x20:170",
                      options.substr(0, 60), what),
          "lens"};
}

}  // namespace

Vec2 stereographic(const Vec3& p_cam) { return 2 / (p_cam.norm() + p_cam.z()) * p_cam.head<2>(); }

Vec3 ray_of_stereographic(const Vec2& u) {
  const double s = 0.25 * u.squaredNorm();
  return Vec3(u.x(), u.y(), 1 - s) / (1 + s);
}

Splined::Splined(int order_, int n_x_, int n_y_, int fov_x_deg_)
    : order(order_), n_x(n_x_), n_y(n_y_), fov_x_deg(fov_x_deg_) {
  PLUMBLINE_CHECK(
      (order == 2 || order == 3) && n_x > order && n_y > order && fov_x_deg > 0 && fov_x_deg < 360,
      "a spline of order 2 or 3 over more knots than that");
  k.assign(static_cast<std::size_t>(4 + 2 * n_x * n_y), 0.0);
  k[0] = k[1] = 1;
}

double Splined::knots_per_unit() const {
  // The outermost knots reach beyond the image: a spline of order 3 needs one more interval at each end, one
  // of order 2 half an interval.
  return (n_x - order) / (4 * std::tan(0.25 * fov_x_deg * kDeg));
}

Vec2 Splined::reach() const { return Vec2(n_x - order, n_y - order) / (2 * knots_per_unit()); }

Vec2 Splined::knot(int i, int j) const {
  return Vec2(i - 0.5 * (n_x - 1), j - 0.5 * (n_y - 1)) / knots_per_unit();
}

std::optional<std::array<int, 2>> Splined::first_knots(const Vec2& u) const {
  if (!within_reach(*this, u)) return std::nullopt;
  const double s = knots_per_unit();
  return std::array<int, 2>{first_knot(order, n_x, u.x() * s + 0.5 * (n_x - 1)),
                            first_knot(order, n_y, u.y() * s + 0.5 * (n_y - 1))};
}

std::vector<std::string> Splined::param_names() const {
  std::vector<std::string> names{"fx", "fy", "cx", "cy"};
  for (int j = 0; j < n_y; ++j) {
    for (int i = 0; i < n_x; ++i) {
      names.push_back(fmt::format("x{}_{}", i, j));
      names.push_back(fmt::format("y{}_{}", i, j));
    }
  }
  return names;
}

std::optional<Vec2> Splined::project(const Vec3& p_cam, Mat23* J_px_p, SparseJac* J_px_k) const {
  const double n = p_cam.norm();
  if (!(n > 0 && n < std::numeric_limits<double>::infinity())) return std::nullopt;
  const double scale = 2 / (n + p_cam.z());
  const Vec2 u = scale * p_cam.head<2>();
  const auto at = correction_at(*this, u);  // false for the infinite u of straight back
  if (!at) return std::nullopt;
  const Mat2 J_m_u = Mat2::Identity() + at->J_c_u;
  const Vec2 m = u + at->c, f(k[0], k[1]), px = f.cwiseProduct(m) + Vec2(k[2], k[3]);
  if (!(J_m_u.determinant() > 0) || !std::isfinite(px.sum())) return std::nullopt;
  if (J_px_p) {
    // d(scale)/d(p) = -scale^2 / 2 (p / n + e_z)
    Vec3 g = p_cam / n;
    g.z() += 1;
    Mat23 J_u_p = u * (-0.5 * scale * g).transpose();
    J_u_p(0, 0) += scale, J_u_p(1, 1) += scale;
    *J_px_p = f.asDiagonal() * J_m_u * J_u_p;
  }
  if (J_px_k) {
    J_px_k->clear();
    J_px_k->add(0, m.x(), 0);
    J_px_k->add(1, 0, m.y());
    J_px_k->add(2, 1, 0);
    J_px_k->add(3, 0, 1);
    for (int j = 0; j <= order; ++j) {
      for (int i = 0; i <= order; ++i) {
        const double w = at->x.value[i] * at->y.value[j];
        const int c = control_point(at->x.first + i, at->y.first + j);
        J_px_k->add(c, f.x() * w, 0);
        J_px_k->add(c + 1, 0, f.y() * w);
      }
    }
  }
  return px;
}

std::optional<Vec3> Splined::unproject(const Vec2& px) const {
  const Vec2 f(k[0], k[1]), m = (px - Vec2(k[2], k[3])).cwiseQuotient(f);
  if (!px.allFinite() || !m.allFinite()) return std::nullopt;
  const double tolerance = (1e-10 + 1e-13 * px.norm()) / f.maxCoeff();
  auto u = newton(*this, m, m, tolerance);
  if (!u) u = newton(*this, m, nearest_knot(*this, m), tolerance);
  if (!u) return std::nullopt;
  return ray_of_stereographic(*u).normalized();
}

std::vector<PriorRow> Splined::priors() const {
  constexpr double kAcross = 10;
  std::vector<PriorRow> rows;
  for (int j = 0; j < n_y; ++j) {
    for (int i = 0; i < n_x; ++i) {
      const Vec2 u = knot(i, j);
      const int c = control_point(i, j);
      const bool centre = u.isZero(0);
      const Vec2 along = centre ? Vec2(1, 0) : u.normalized();
      const double across = centre ? 1 : kAcross;
      rows.push_back({{c, c + 1}, {along.x(), along.y()}});
      rows.push_back({{c, c + 1}, {across * along.y(), -across * along.x()}});
    }
  }
  return rows;
}

Result<Splined> Splined::make(std::string_view text, ImageSize size, double focal_px) {
  if (text.empty()) {
    // What a stereographic lens of this focal length sees in the image.
    const Vec2 edge = 0.5 * Vec2(std::max(size.width, 2), std::max(size.height, 2)) / focal_px;
    const std::vector<Vec3> rays{ray_of_stereographic({edge.x(), 0}), ray_of_stereographic({0, edge.y()})};
    return make(options_for(size, rays), size, focal_px);
  }
  const auto words = split(text, ':');
  const auto grid = split(words[0], 'x');
  if (words.size() < 2 || words.size() > 3 || grid.size() != 2) return bad_options(text, "not understood");
  const auto n_x = parse_int(grid[0]), n_y = parse_int(grid[1]), fov = parse_int(words[1]),
             order = words.size() > 2 ? parse_int(words[2]) : std::optional(3);
  if (!n_x || !n_y || !fov || !order) return bad_options(text, "whole numbers are needed");
  if (*order != 2 && *order != 3)
    return bad_options(text, fmt::format("order {} is neither 2 nor 3", *order));
  if (*n_x <= *order || *n_y <= *order || *n_x > 500 || *n_y > 500)
    return bad_options(text, fmt::format("{}x{} knots: {} to 500 each way", *n_x, *n_y, *order + 1));
  if (*fov < 1 || *fov > 359) return bad_options(text, fmt::format("{} degrees: 1 to 359", *fov));
  Splined lens(*order, *n_x, *n_y, *fov);
  lens.k[0] = lens.k[1] = focal_px;
  lens.k[2] = 0.5 * (size.width - 1), lens.k[3] = 0.5 * (size.height - 1);
  return lens;
}

std::string Splined::options_for(ImageSize size, std::span<const Vec3> rays) {
  constexpr double kAround = 1.06;
  Vec2 reach = Vec2::Constant(1e-2);
  for (const Vec3& ray : rays) {
    const Vec2 u = stereographic(ray);
    if (u.allFinite()) reach = reach.cwiseMax(kAround * u.cwiseAbs());
  }
  const int fov = std::clamp(static_cast<int>(std::ceil(4 * std::atan(0.5 * reach.x()) / kDeg)), 1, 350);
  const int n_x = std::clamp(6 + size.width / 64, 8, 30);
  const double knots_per_unit = (n_x - 3) / (4 * std::tan(0.25 * fov * kDeg));
  const int n_y = std::clamp(3 + static_cast<int>(std::ceil(2 * reach.y() * knots_per_unit)), 5, 200);
  return fmt::format("{}x{}:{}", n_x, n_y, fov);
}

std::string Splined::options() const {
  return fmt::format("{}x{}:{}{}", n_x, n_y, fov_x_deg, order == 2 ? ":2" : "");
}

}  // namespace plumbline
