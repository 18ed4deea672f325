// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/homography.hpp"

#include <fmt/format.h>

#include <optional>
#include <utility>

#include "linear/dlt.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "homography";

// Leaving out the point of largest leverage leaves a line: det(scatter without it) = (1 - leverage)
// det(scatter).
constexpr double kLeverageLeft = 1e-10;

Error degenerate(std::string text) { return {ErrorCode::kDegenerate, std::move(text), kWhere}; }

std::optional<Error> refuse_line(const detail::Spread& s, Eigen::Index n, const char* plane) {
  if (s.flatness() < detail::kFlat) {
    return degenerate(
        fmt::format("the {} points of the {} lie on a line (width over length {:.2g}, at least {:.0e} is "
                    "needed); use points that span an area",
                    n, plane, s.flatness(), detail::kFlat));
  }
  if (1 - s.leverage < kLeverageLeft) {
    return degenerate(
        fmt::format("all but one of the {} points of the {} lie on a line (1 - leverage {:.2g}, at least "
                    "{:.0e} is needed); add points off that line",
                    n, plane, 1 - s.leverage, kLeverageLeft));
  }
  return std::nullopt;
}

std::optional<Error> refuse_solution(const detail::DltSolution& solution) {
  if (solution.determinacy < detail::kRankTolerance) {
    return degenerate(
        fmt::format("more than one homography fits (singular value ratio {:.2g}, at least {:.0e} is "
                    "needed); add points that span an area",
                    solution.determinacy, detail::kRankTolerance));
  }
  const Vec3 s = svd3(Mat3(solution.H)).s;
  if (s[2] < detail::kRankTolerance * s[0]) {
    return degenerate(
        fmt::format("the homography is singular (singular value ratio {:.2g}, at least {:.0e} is needed); "
                    "the plane is seen edge-on or the points do not correspond",
                    s[2] / s[0], detail::kRankTolerance));
  }
  return std::nullopt;
}

}  // namespace

Result<Mat3> homography(std::span<const Vec2> a, std::span<const Vec2> b) {
  PLUMBLINE_CHECK(a.size() == b.size() && a.size() >= 4,
                  "homography needs as many points in a as in b, 4 or more");
  const MatX am = detail::as_matrix(a), bm = detail::as_matrix(b);
  if (!am.allFinite() || !bm.allFinite()) {
    return Error{ErrorCode::kInvalidData, "a coordinate is not a finite number; remove that point", kWhere};
  }
  const detail::Spread sa = detail::spread(am), sb = detail::spread(bm);
  if (const auto e = refuse_line(sa, am.cols(), "first plane")) return *e;
  if (const auto e = refuse_line(sb, bm.cols(), "second plane")) return *e;
  const Mat3 Ta = detail::normalising_similarity(sa), Tb = detail::normalising_similarity(sb);
  const detail::DltSolution solution = detail::solve_dlt(
      detail::to_homogeneous(Ta, am), detail::pixel_constraints(detail::to_homogeneous(Tb, bm)));
  if (const auto e = refuse_solution(solution)) return *e;
  Mat3 H = Tb.inverse() * Mat3(solution.H) * Ta;
  H /= H.norm();
  if (H.row(2).dot(a[0].homogeneous()) < 0) H = -H;
  return H;
}

Result<Mat3> homography_to_rays(std::span<const Vec2> a, std::span<const Vec3> rays_cam) {
  PLUMBLINE_CHECK(a.size() == rays_cam.size() && a.size() >= 4,
                  "homography_to_rays needs as many points as rays, 4 or more");
  const MatX am = detail::as_matrix(a);
  if (!am.allFinite() || !detail::as_matrix(rays_cam).allFinite()) {
    return Error{ErrorCode::kInvalidData, "a coordinate is not a finite number; remove that point", kWhere};
  }
  const detail::Spread sa = detail::spread(am);
  if (const auto e = refuse_line(sa, am.cols(), "plane")) return *e;
  const detail::PreparedRays prepared = detail::prepare_rays(rays_cam);
  if (prepared.flatness < detail::kFlat) {
    return degenerate(
        fmt::format("the {} rays lie in one plane (flatness {:.2g}, at least {:.0e} is needed): the board "
                    "is seen edge-on; tilt it towards the camera",
                    rays_cam.size(), prepared.flatness, detail::kFlat));
  }
  const Mat3 Ta = detail::normalising_similarity(sa);
  const detail::DltSolution solution = detail::solve_dlt(detail::to_homogeneous(Ta, am), prepared.E);
  if (const auto e = refuse_solution(solution)) return *e;
  Mat3 H = prepared.T.inverse() * Mat3(solution.H) * Ta;
  H /= H.norm();
  double along = 0;
  for (std::size_t i = 0; i < a.size(); ++i) along += rays_cam[i].dot((H * a[i].homogeneous()).normalized());
  return along < 0 ? Mat3(-H) : H;
}

}  // namespace plumbline
