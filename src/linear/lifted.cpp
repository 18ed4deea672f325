// SPDX-License-Identifier: Apache-2.0
#include "linear/lifted.hpp"

#include <cmath>

namespace plumbline::detail {

Mat3 Normaliser::T() const {
  Mat3 M;
  M << scale, 0, -scale * centre.x(), 0, scale, -scale * centre.y(), 0, 0, 1;
  return M;
}

Normaliser normaliser_of(std::span<const Vec2> px) {
  Normaliser out;
  const double n = static_cast<double>(px.size());
  for (const Vec2& p : px) out.centre += p / n;
  double sum = 0;
  for (const Vec2& p : px) sum += (p - out.centre).squaredNorm();
  if (sum > 0) out.scale = std::sqrt(2 * n / sum);
  return out;
}

Lifted lift(const Normaliser& normaliser, const Vec2& px) {
  const Vec2 p = normaliser.scale * (px - normaliser.centre);
  Lifted out;
  out.v = p.homogeneous();
  out.J_v_px << normaliser.scale, 0, 0, normaliser.scale, 0, 0;
  out.J_px_v << 1, 0, -p.x(), 0, 1, -p.y();
  out.J_px_v /= normaliser.scale;
  out.measure = Vec3::UnitZ();
  return out;
}

std::vector<Lifted> lift(const Normaliser& normaliser, std::span<const Vec2> px) {
  std::vector<Lifted> out;
  out.reserve(px.size());
  for (const Vec2& p : px) out.push_back(lift(normaliser, p));
  return out;
}

Lifted lift_ray(const Vec3& ray) {
  Lifted out;
  out.v = ray.normalized();
  out.measure = out.v;
  const Vec3 across = out.v.unitOrthogonal();
  out.J_v_px << across, out.v.cross(across);
  out.J_px_v = out.J_v_px.transpose();
  return out;
}

std::optional<Lifted> lift(const Lens& lens, const Vec2& px) {
  const auto ray = unproject(lens, px);
  if (!ray) return std::nullopt;
  Lifted out;
  if (!project(lens, *ray, &out.J_px_v)) return std::nullopt;
  out.v = out.measure = *ray;
  const Mat2 A = out.J_px_v * out.J_px_v.transpose();
  const double det = A.determinant();
  if (!(det > 0) || !std::isfinite(det)) return std::nullopt;
  out.J_v_px = out.J_px_v.transpose() * A.inverse();  // pseudo-inverse: its columns are across the ray
  return out;
}

bool is_oriented(const Mat3& F, std::span<const Lifted> a, std::span<const Lifted> b,
                 std::span<const int> of) {
  const Vec3 e2 = left_null(F);
  bool positive = false, negative = false;
  for (const int i : of) {
    const auto k = static_cast<std::size_t>(i);
    const double s = e2.cross(b[k].v).dot(F * a[k].v);
    positive |= s > 0;
    negative |= s < 0;
  }
  return !(positive && negative);
}

}  // namespace plumbline::detail
