// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/camera_matrix.hpp"

#include <fmt/format.h>

#include <cmath>
#include <optional>
#include <utility>

#include "linear/dlt.hpp"
#include "linear/pixel_dlt.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "camera matrix";
constexpr double kLeverageLeft = 1e-10;  // as in homography.cpp, for planes instead of lines

Error degenerate(std::string text) { return {ErrorCode::kDegenerate, std::move(text), kWhere}; }

std::optional<Error> refuse_plane(double flatness, double leverage, std::size_t n) {
  if (flatness < detail::kFlat) {
    return degenerate(fmt::format(
        "the {} points are coplanar (thickness over extent {:.2g}, at least {:.0e} is needed): a plane does "
        "not "
        "determine a camera matrix; use a target with depth, or the homographies of several flat views",
        n, flatness, detail::kFlat));
  }
  if (1 - leverage < kLeverageLeft) {
    return degenerate(
        fmt::format("all but one of the {} points are coplanar (1 - leverage {:.2g}, at least {:.0e} is "
                    "needed), which does not "
                    "determine a camera matrix; add points off that plane",
                    n, 1 - leverage, kLeverageLeft));
  }
  return std::nullopt;
}

// Root mean square distance of the pixels from the images by P, each weighed by its depth: the algebraic
// error in normalised pixels.
double weighted_error(const Mat34& P, std::span<const Vec3> X, std::span<const Vec2> x) {
  double error = 0, weight = 0;
  for (std::size_t i = 0; i < X.size(); ++i) {
    const Vec3 image = P * X[i].homogeneous();
    error += (image.head<2>() - image.z() * x[i]).squaredNorm();
    weight += image.z() * image.z();
  }
  return std::sqrt(error / weight);
}

// On a twisted cubic through the camera (and in other critical places) a second camera matrix fits, exactly
// without noise and as well as the noise allows with it. The residuals of P tell the noise, from eight points
// on when they have five degrees of freedom to tell it by.
std::optional<Error> refuse_twin(const detail::PixelDlt<4>& solution, std::span<const Vec3> X,
                                 std::span<const Vec2> x) {
  constexpr double kTwin = 3;
  const double n = static_cast<double>(X.size());
  if (n < 8) return std::nullopt;
  const double noise = weighted_error(solution.H, X, x) * std::sqrt(2 * n / (2 * n - 11));
  const double twin = weighted_error(solution.next, X, x);
  if (!(twin < kTwin * noise)) return std::nullopt;
  return degenerate(fmt::format(
      "more than one camera matrix fits within the noise (a second one leaves {:.2g} times the "
      "error of the best, at least {:g} is needed): the points lie on a twisted cubic through the "
      "camera or near another critical surface, or many do not correspond; add points elsewhere",
      twin / noise, kTwin));
}

std::optional<Error> refuse_solution(const Mat34& P, double determinacy) {
  if (determinacy < detail::kRankTolerance) {
    return degenerate(
        fmt::format("more than one camera matrix fits (singular value ratio {:.2g}, at least {:.0e} is "
                    "needed): the points lie in "
                    "a plane and on a line, or on a twisted cubic through the camera; add points elsewhere",
                    determinacy, detail::kRankTolerance));
  }
  const Vec3 s = svd3(P.leftCols<3>()).s;
  if (s[2] < detail::kRankTolerance * s[0]) {
    return degenerate(
        fmt::format("the camera matrix is singular (singular value ratio {:.2g}, at least {:.0e} is needed): "
                    "the points do not "
                    "correspond, or a camera at infinity took them; check the order of the points",
                    s[2] / s[0], detail::kRankTolerance));
  }
  return std::nullopt;
}

Error not_finite() {
  return {ErrorCode::kInvalidData, "a coordinate is not a finite number; remove that point", kWhere};
}

}  // namespace

Result<Mat34> camera_matrix(std::span<const Vec3> p_world, std::span<const Vec2> px) {
  PLUMBLINE_CHECK(p_world.size() == px.size() && px.size() >= 6,
                  "camera_matrix needs as many points as pixels, 6 or more");
  const auto X = detail::normalise<3>(p_world);
  const auto x = detail::normalise<2>(px);
  if (!X.T.allFinite() || !x.T.allFinite()) return not_finite();
  if (const auto e = refuse_plane(X.flatness, X.leverage, px.size())) return *e;
  if (x.flatness < detail::kFlat) {
    return degenerate(
        fmt::format("the {} pixels lie on a line (width over length {:.2g}); a camera cannot see points "
                    "with depth so: check the order of the points",
                    px.size(), x.flatness));
  }
  const auto solution = detail::solve_pixel_dlt<4>(X.x, x.x);
  if (const auto e = refuse_solution(solution.H, solution.determinacy)) return *e;
  if (const auto e = refuse_twin(solution, X.x, x.x)) return *e;
  Mat34 P = x.T.inverse() * solution.H * X.T;
  P /= P.row(2).head<3>().norm();
  double depth = 0;
  for (const Vec3& p : p_world) depth += P.row(2).dot(p.homogeneous());
  return depth < 0 ? Mat34(-P) : P;
}

Result<Mat34> camera_matrix_to_rays(std::span<const Vec3> p_world, std::span<const Vec3> rays_cam) {
  PLUMBLINE_CHECK(p_world.size() == rays_cam.size() && rays_cam.size() >= 6,
                  "camera_matrix_to_rays needs as many points as rays, 6 or more");
  const MatX X = detail::as_matrix(p_world);
  if (!X.allFinite() || !detail::as_matrix(rays_cam).allFinite()) return not_finite();
  const detail::Spread sX = detail::spread(X);
  if (const auto e = refuse_plane(sX.flatness(), sX.leverage, p_world.size())) return *e;
  const detail::PreparedRays prepared = detail::prepare_rays(rays_cam);
  if (prepared.flatness < detail::kFlat) {
    return degenerate(
        fmt::format("the {} rays lie in one plane (flatness {:.2g}); a camera cannot see points with "
                    "depth so: check the order of the points",
                    rays_cam.size(), prepared.flatness));
  }
  const Mat4 TX = detail::normalising_similarity(sX);
  const detail::DltSolution solution = detail::solve_dlt(detail::to_homogeneous(TX, X), prepared.E);
  if (const auto e = refuse_solution(solution.H, solution.determinacy)) return *e;
  Mat34 P = prepared.T.inverse() * Mat34(solution.H) * TX;
  P /= std::cbrt(std::abs(P.leftCols<3>().determinant()));
  double along = 0;
  for (std::size_t i = 0; i < p_world.size(); ++i) {
    along += rays_cam[i].dot((P * p_world[i].homogeneous()).normalized());
  }
  return along < 0 ? Mat34(-P) : P;
}

}  // namespace plumbline
