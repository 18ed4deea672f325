// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/triangulate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include "linear/dlt.hpp"
#include "linear/row_qr.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "triangulation";
constexpr double kDegrees = 180 / std::numbers::pi;

Error degenerate(std::string text) { return {ErrorCode::kDegenerate, std::move(text), kWhere}; }
Error invalid(std::string text) { return {ErrorCode::kInvalidData, std::move(text), kWhere}; }

Error too_few(std::size_t n, const char* what) {
  return degenerate(fmt::format("{} {}: a point needs two, from different places; add one more", n, what));
}

Error behind(std::size_t i) {
  return invalid(fmt::format(
      "the lines of sight meet behind camera {} (counted from 0), against its ray: the pixels are not of one "
      "point, or the poses are wrong; check the correspondence",
      i));
}

// A pixel's line of sight with what a step across it at unit distance is worth in pixels; J * direction = 0.
struct Sight {
  Vec3 centre;
  Vec3 direction;  // unit
  Mat23 J_px_p;
};

// The angle between two directions taken as lines, [0, pi/2].
double line_angle(const Vec3& a, const Vec3& b) { return std::atan2(a.cross(b).norm(), std::abs(a.dot(b))); }

template <class DirectionOf>
double largest_angle(std::size_t n, DirectionOf&& direction_of) {
  double angle = 0;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < i; ++j) angle = std::max(angle, line_angle(direction_of(i), direction_of(j)));
  }
  return angle;
}

// The left 3x3 of the triangle is A of A x = b, its last column b.
Vec3 solve_upper(const detail::RowQr<4>& qr) {
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> R = qr.R.topLeftCorner<3, 3>();
  return detail::inverse_of_upper(R) * qr.R.topRightCorner<3, 1>();
}

// Origin and unit of length in which cameras are well scaled: the mean of their centres, the farthest of
// them.
struct Scale {
  Vec3 origin = Vec3::Zero();
  double length = 0;
};
template <class CentreOf>
Scale scale_of(std::size_t n, CentreOf&& centre_of) {
  Scale s;
  for (std::size_t i = 0; i < n; ++i) s.origin += centre_of(i) / static_cast<double>(n);
  for (std::size_t i = 0; i < n; ++i) s.length = std::max(s.length, (centre_of(i) - s.origin).norm());
  return s;
}

Error parallel(double angle_rad, std::optional<double> sigma_rad) {
  const std::string noise =
      sigma_rad ? fmt::format(" with a standard deviation of {:.2g} degrees (at least {} of them are needed)",
                              *sigma_rad * kDegrees, kParallelSigmas)
                : fmt::format(" (at least {:.0e} is needed)", kParallelRad * kDegrees);
  return degenerate(fmt::format(
      "the rays are parallel: the largest angle between them is {:.2g} degrees{}; the point is too "
      "far away for these views: use views that are farther apart",
      angle_rad * kDegrees, noise));
}

// The standard deviation of the distance to the point over the distance, for the camera where it is largest.
double relative_depth_sigma(std::span<const Sight> sights, const Vec3& p, const Mat3& covariance) {
  double worst = 0;
  for (const Sight& s : sights) {
    const Vec3 line = p - s.centre;
    const double distance2 = line.squaredNorm();
    // d' C d / |d|^4 with d the line of sight: (sigma / distance)^2
    worst = std::max(worst, line.dot(covariance * line) / (distance2 * distance2));
  }
  return std::sqrt(worst);
}

// Everything but rms_px of a point; the refusals of triangulate().
Result<Triangulated> describe(std::span<const Sight> sights, const Vec3& p, double sigma_px) {
  Triangulated result;
  result.p_world = p;
  result.ray_angle_rad = largest_angle(sights.size(), [&](std::size_t i) { return sights[i].direction; });
  detail::RowQr<3> information;
  for (const Sight& s : sights) {
    const Mat23 J = s.J_px_p / (sigma_px * (p - s.centre).norm());
    information.add(J.row(0));
    information.add(J.row(1));
  }
  const auto R_inverse = detail::inverse_of_upper(information.R);
  result.covariance = R_inverse * R_inverse.transpose();
  const double depth_sigma = relative_depth_sigma(sights, p, result.covariance);
  if (!(result.ray_angle_rad >= kParallelRad) || !std::isfinite(depth_sigma)) {
    return parallel(result.ray_angle_rad, std::nullopt);
  }
  // distance ~ 1 / angle: both have the same relative deviation
  if (depth_sigma * kParallelSigmas > 1) {
    return parallel(result.ray_angle_rad, depth_sigma * result.ray_angle_rad);
  }
  for (std::size_t i = 0; i < sights.size(); ++i) {
    if (!(sights[i].direction.dot(p - sights[i].centre) > 0)) return behind(i);
  }
  return result;
}

Result<Triangulated> solve(std::span<const Sight> sights, double sigma_px) {
  if (sights.size() < 2) return too_few(sights.size(), sights.size() == 1 ? "view" : "views");
  const auto direction_of = [&](std::size_t i) { return sights[i].direction; };
  const Scale scale = scale_of(sights.size(), [&](std::size_t i) { return sights[i].centre; });
  if (!(scale.length > 0)) {
    return degenerate(
        "the views are from one place, so that their rays are parallel wherever the point is; use views that "
        "are farther apart");
  }
  // Homogeneous first: a point so far away that noise puts it behind the cameras is met on its way to
  // infinity.
  detail::RowQr<4> homogeneous;
  for (const Sight& s : sights) {
    Eigen::Matrix<double, 2, 4> rows;
    rows << s.J_px_p, -s.J_px_p * (s.centre - scale.origin) / scale.length;
    homogeneous.add(rows.row(0));
    homogeneous.add(rows.row(1));
  }
  const detail::UpperNull<4> X = detail::null_of_upper<4>(homogeneous.R);
  Vec3 p = X.v.head<3>() / X.v[3];
  if (!p.allFinite() || !(X.determinacy >= detail::kRankTolerance)) {
    return parallel(largest_angle(sights.size(), direction_of), std::nullopt);
  }
  detail::RowQr<4> weighted;
  for (const Sight& s : sights) {
    const Vec3 centre = (s.centre - scale.origin) / scale.length;
    Eigen::Matrix<double, 2, 4> rows;
    rows << s.J_px_p, s.J_px_p * centre;
    rows /= (p - centre).norm();
    weighted.add(rows.row(0));
    weighted.add(rows.row(1));
  }
  p = solve_upper(weighted);
  if (!p.allFinite()) return parallel(largest_angle(sights.size(), direction_of), std::nullopt);
  return describe(sights, scale.origin + scale.length * p, sigma_px);
}

Result<Sight> sight_of(const PosedLens& camera, const Vec2& px, std::size_t i) {
  Mat23 J;
  const auto ray = unproject(camera.lens, px);
  if (!ray || !project(camera.lens, *ray, &J)) {
    return invalid(
        fmt::format("pixel ({:.6g}, {:.6g}) of camera {} (counted from 0) has no ray in its lens {}; "
                    "leave it out, or check the lens",
                    px.x(), px.y(), i, lens_name(camera.lens)));
  }
  const Mat3 R = camera.T_cam_world.R();
  return Sight{-(R.transpose() * camera.T_cam_world.t()), R.transpose() * *ray, J * R};
}

Result<Sight> sight_of(const Mat34& P, const Vec2& px, std::size_t i) {
  const Mat3 M = P.leftCols<3>();
  const double det = M.determinant(), size = M.row(0).norm() * M.row(1).norm() * M.row(2).norm();
  if (!px.allFinite() || !P.allFinite() || !(std::abs(det) > 1e-12 * size)) {
    return invalid(fmt::format(
        "the pixel of camera {} (counted from 0) is not a number, or its camera matrix has no finite centre "
        "(determinant of its left block {:.2g} of the rows' lengths); check the camera matrix",
        i, std::abs(det) / size));
  }
  const Mat3 M_inverse = M.inverse();
  const Vec3 line = M_inverse * px.homogeneous();
  const Vec3 direction = line.normalized() * (det < 0 ? -1.0 : 1.0);
  // px = (M d)_{xy} / (M d)_z
  const double depth = M.row(2).dot(direction);
  Mat23 J;
  J.row(0) = (M.row(0) - px.x() * M.row(2)) / depth;
  J.row(1) = (M.row(1) - px.y() * M.row(2)) / depth;
  return Sight{-(M_inverse * P.col(3)), direction, J};
}

template <class Camera>
Result<std::vector<Sight>> sights_of(std::span<const Camera> cameras, std::span<const Vec2> px,
                                     double sigma_px) {
  PLUMBLINE_CHECK(cameras.size() == px.size(), "triangulate needs as many pixels as cameras");
  PLUMBLINE_CHECK(sigma_px > 0 && std::isfinite(sigma_px), "triangulate needs a sigma_px above 0");
  std::vector<Sight> sights;
  sights.reserve(px.size());
  for (std::size_t i = 0; i < px.size(); ++i) {
    auto sight = sight_of(cameras[i], px[i], i);
    if (!sight) return sight.error();
    sights.push_back(*sight);
  }
  return sights;
}

std::optional<Vec2> image_in(const PosedLens& camera, const Vec3& p) {
  return project(camera.lens, camera.T_cam_world * p);
}
std::optional<Vec2> image_in(const Mat34& P, const Vec3& p) {
  return Vec2((P * p.homogeneous()).hnormalized());
}

template <class Camera>
Result<Triangulated> with_error(Result<Triangulated> result, std::span<const Camera> cameras,
                                std::span<const Vec2> px) {
  if (!result) return result;
  double sum = 0;
  for (std::size_t i = 0; i < px.size(); ++i) {
    const auto image = image_in(cameras[i], result->p_world);
    if (!image) {
      return invalid(fmt::format(
          "the lens of camera {} (counted from 0) does not see the point where the lines of sight meet: the "
          "pixels are not of one point, or the poses are wrong; check the correspondence",
          i));
    }
    sum += (*image - px[i]).squaredNorm();
  }
  result->rms_px = std::sqrt(sum / static_cast<double>(px.size()));
  return result;
}

}  // namespace

Result<Triangulated> triangulate(std::span<const PosedLens> cameras, std::span<const Vec2> px,
                                 double sigma_px) {
  const auto sights = sights_of(cameras, px, sigma_px);
  if (!sights) return sights.error();
  return with_error(solve(*sights, sigma_px), cameras, px);
}

Result<Triangulated> triangulate(std::span<const Mat34> P_px_world, std::span<const Vec2> px,
                                 double sigma_px) {
  const auto sights = sights_of(P_px_world, px, sigma_px);
  if (!sights) return sights.error();
  return with_error(solve(*sights, sigma_px), P_px_world, px);
}

Result<Triangulated> triangulated_at(const Vec3& p_world, std::span<const PosedLens> cameras,
                                     std::span<const Vec2> px, double sigma_px) {
  const auto sights = sights_of(cameras, px, sigma_px);
  if (!sights) return sights.error();
  if (sights->size() < 2) return too_few(sights->size(), "views");
  return with_error(describe(*sights, p_world, sigma_px), cameras, px);
}

Result<Vec4> triangulate_linear(std::span<const Mat34> P_px_world, std::span<const Vec2> px) {
  PLUMBLINE_CHECK(P_px_world.size() == px.size(), "triangulate_linear needs as many pixels as cameras");
  if (px.size() < 2) return too_few(px.size(), "views");
  detail::RowQr<4> qr;
  for (std::size_t i = 0; i < px.size(); ++i) {
    const Mat34& P = P_px_world[i];
    const Eigen::RowVector4d a = P.row(0) - px[i].x() * P.row(2), b = P.row(1) - px[i].y() * P.row(2);
    const double length = std::sqrt(a.squaredNorm() + b.squaredNorm());
    if (!std::isfinite(length) || !(length > 0)) {
      return invalid(
          fmt::format("view {} (counted from 0): a number is not finite, or its camera matrix is 0", i));
    }
    qr.add(a / length);
    qr.add(b / length);
  }
  const Vec4 columns = qr.R.colwise().norm().transpose().cwiseMax(1e-300);
  const detail::UpperNull<4> X = detail::null_of_upper<4>(qr.R * columns.cwiseInverse().asDiagonal());
  if (!(X.determinacy >= detail::kRankTolerance)) {
    return degenerate(
        fmt::format("more than one point fits (singular value ratio {:.2g}, at least {:.0e} is needed): the "
                    "views have one centre, or the point is on the line through them; use views that are "
                    "farther apart",
                    X.determinacy, detail::kRankTolerance));
  }
  const Vec4 point = X.v.cwiseQuotient(columns).normalized();
  return Vec4(point[3] < 0 ? Vec4(-point) : point);
}

Result<Vec3> triangulate_midpoint(std::span<const WorldRay> rays) {
  const std::size_t n = rays.size();
  if (n < 2) return too_few(n, n == 1 ? "ray" : "rays");
  std::vector<Vec3> directions;
  directions.reserve(n);
  for (std::size_t i = 0; i < n; ++i) {
    directions.push_back(rays[i].direction.normalized());
    if (!rays[i].origin.allFinite() || !(directions.back().squaredNorm() > 0.5)) {
      return invalid(
          fmt::format("ray {} (counted from 0) has no direction or is not finite; leave it out", i));
    }
  }
  const double angle = largest_angle(n, [&](std::size_t i) { return directions[i]; });
  if (!(angle >= kParallelRad)) return parallel(angle, std::nullopt);
  const Scale scale = scale_of(n, [&](std::size_t i) { return rays[i].origin; });
  detail::RowQr<4> qr;
  for (std::size_t i = 0; i < n; ++i) {
    const Vec3& d = directions[i];
    // Two directions across the ray.
    const Vec3 u = d.cross(std::abs(d.x()) < 0.6 ? Vec3::UnitX() : Vec3::UnitY()).normalized(),
               v = d.cross(u);
    const Vec3 origin = rays[i].origin - scale.origin;
    qr.add((Eigen::RowVector4d() << u.transpose(), u.dot(origin)).finished());
    qr.add((Eigen::RowVector4d() << v.transpose(), v.dot(origin)).finished());
  }
  const Vec3 p = scale.origin + solve_upper(qr);
  for (std::size_t i = 0; i < n; ++i) {
    if (!(directions[i].dot(p - rays[i].origin) > 0)) return behind(i);
  }
  return p;
}

}  // namespace plumbline
