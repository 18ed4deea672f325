// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/homography.hpp"

#include <fmt/format.h>

#include <cmath>
#include <optional>
#include <utility>

#include "linear/dlt.hpp"
#include "linear/pixel_dlt.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "homography";

// Leaving out the point of largest leverage leaves a line: det(scatter without it) = (1 - leverage)
// det(scatter).
constexpr double kLeverageLeft = 1e-10;

Error degenerate(std::string text) { return {ErrorCode::kDegenerate, std::move(text), kWhere}; }

std::optional<Error> refuse_line(double flatness, double leverage, std::size_t n, const char* plane) {
  if (flatness < detail::kFlat) {
    return degenerate(
        fmt::format("the {} points of the {} lie on a line (width over length {:.2g}, at least {:.0e} is "
                    "needed); use points that span an area",
                    n, plane, flatness, detail::kFlat));
  }
  if (1 - leverage < kLeverageLeft) {
    return degenerate(
        fmt::format("all but one of the {} points of the {} lie on a line (1 - leverage {:.2g}, at least "
                    "{:.0e} is needed); add points off that line",
                    n, plane, 1 - leverage, kLeverageLeft));
  }
  return std::nullopt;
}

std::optional<Error> refuse_solution(const Mat3& H, double determinacy) {
  if (determinacy < detail::kRankTolerance) {
    return degenerate(
        fmt::format("more than one homography fits (singular value ratio {:.2g}, at least {:.0e} is "
                    "needed); add points that span an area",
                    determinacy, detail::kRankTolerance));
  }
  // For |H| = 1 the determinant is below the ratio of the singular values, and cheaper.
  if (std::abs(H.determinant()) > detail::kRankTolerance) return std::nullopt;
  const Vec3 s = svd3(H).s;
  if (s[2] < detail::kRankTolerance * s[0]) {
    return degenerate(
        fmt::format("the homography is singular (singular value ratio {:.2g}, at least {:.0e} is needed); "
                    "the plane is seen edge-on or the points do not correspond",
                    s[2] / s[0], detail::kRankTolerance));
  }
  return std::nullopt;
}

Error not_finite() {
  return {ErrorCode::kInvalidData, "a coordinate is not a finite number; remove that point", kWhere};
}

}  // namespace

Result<Mat3> homography(std::span<const Vec2> a, std::span<const Vec2> b) {
  PLUMBLINE_CHECK(a.size() == b.size() && a.size() >= 4,
                  "homography needs as many points in a as in b, 4 or more");
  const auto na = detail::normalise<2>(a), nb = detail::normalise<2>(b);
  if (!na.T.allFinite() || !nb.T.allFinite()) return not_finite();
  if (const auto e = refuse_line(na.flatness, na.leverage, a.size(), "first plane")) return *e;
  if (const auto e = refuse_line(nb.flatness, nb.leverage, b.size(), "second plane")) return *e;
  const auto solution = detail::solve_pixel_dlt<3>(na.x, nb.x);
  if (const auto e = refuse_solution(solution.H, solution.determinacy)) return *e;
  Mat3 H = nb.T.inverse() * solution.H * na.T;
  H /= H.norm();
  if (H.row(2).dot(a[0].homogeneous()) < 0) H = -H;
  return H;
}

Result<Mat3> homography_to_rays(std::span<const Vec2> a, std::span<const Vec3> rays_cam) {
  PLUMBLINE_CHECK(a.size() == rays_cam.size() && a.size() >= 4,
                  "homography_to_rays needs as many points as rays, 4 or more");
  const MatX am = detail::as_matrix(a);
  if (!am.allFinite() || !detail::as_matrix(rays_cam).allFinite()) return not_finite();
  const detail::Spread sa = detail::spread(am);
  if (const auto e = refuse_line(sa.flatness(), sa.leverage, a.size(), "plane")) return *e;
  const detail::PreparedRays prepared = detail::prepare_rays(rays_cam);
  if (prepared.flatness < detail::kFlat) {
    return degenerate(
        fmt::format("the {} rays lie in one plane (flatness {:.2g}, at least {:.0e} is needed): the board "
                    "is seen edge-on; tilt it towards the camera",
                    rays_cam.size(), prepared.flatness, detail::kFlat));
  }
  const Mat3 Ta = detail::normalising_similarity(sa);
  const detail::DltSolution solution = detail::solve_dlt(detail::to_homogeneous(Ta, am), prepared.E);
  if (const auto e = refuse_solution(solution.H, solution.determinacy)) return *e;
  Mat3 H = prepared.T.inverse() * Mat3(solution.H) * Ta;
  H /= H.norm();
  double along = 0;
  for (std::size_t i = 0; i < a.size(); ++i) along += rays_cam[i].dot((H * a[i].homogeneous()).normalized());
  return along < 0 ? Mat3(-H) : H;
}

}  // namespace plumbline
