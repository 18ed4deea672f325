// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/pose.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "linear/ray_pose.hpp"
#include "plumbline/core/linalg.hpp"
#include "plumbline/linear/camera_matrix.hpp"
#include "plumbline/linear/homography.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "pose";
// Points thicker than this also start from a DLT.
constexpr double kSolid = 1e-3;

Error degenerate(std::string text) { return {ErrorCode::kDegenerate, std::move(text), kWhere}; }

// From the homography of the points' best plane, in the frame of that plane. The other pose, which mirrors a
// small board's normal at the line of sight, is not tried: over 27 000 random views of a 12 cm board at 1 to
// 8 m with 0.1 to 1 px of noise, trying it too changed one.
Result<SE3> planar_start(const detail::RaySighting& s, const detail::Spread& spread) {
  const SE3 T_plane_board = detail::plane_frame(spread);
  std::vector<Vec2> a;
  for (const Vec3& p : s.p_board) a.push_back((T_plane_board * p).head<2>());
  const auto H = homography_to_rays(a, s.rays_cam);
  if (!H) return H.error();
  const auto T_cam_plane = pose_from_homography(*H);
  if (!T_cam_plane) return T_cam_plane.error();
  return *T_cam_plane * T_plane_board;
}

Result<SE3> solid_start(std::span<const Vec3> p_world, std::span<const Vec3> rays_cam) {
  const auto P = camera_matrix_to_rays(p_world, rays_cam);
  if (!P) return P.error();
  const Mat3 M = P->leftCols<3>();
  if (M.determinant() < 0) {
    return degenerate(
        "the rays see a mirror image of the points (det R < 0); check the order and the axes of the points");
  }
  const Svd3 d = svd3(M);
  return SE3(d.U * d.V.transpose(), P->col(3) / d.s.mean());
}

}  // namespace

Result<SE3> pose_from_homography(const Mat3& H_ray_board) {
  const Vec3 h1 = H_ray_board.col(0), h2 = H_ray_board.col(1), normal = h1.cross(h2);
  const double area = h1.norm() * h2.norm(), sine = area > 0 ? normal.norm() / area : 0.0;
  if (!H_ray_board.allFinite() || !(sine > 1e-9)) {
    return degenerate(
        fmt::format("the homography's first two columns are parallel (sine of their angle {:.2g}): the "
                    "board is seen edge-on; tilt it towards the camera",
                    H_ray_board.allFinite() ? sine : 0.0));
  }
  // Columns of unequal noise share one scale: the third column takes their geometric mean as its length.
  Mat3 A;
  A << h1, h2, normal / normal.norm() * std::sqrt(area);
  const Mat3 R = nearest_rotation(A);
  const double scale = 0.5 * (R.col(0).dot(h1) + R.col(1).dot(h2));
  return SE3(R, H_ray_board.col(2) / scale);
}

Result<SE3> pose_linear(std::span<const Vec3> p_world, std::span<const Vec3> rays_cam) {
  PLUMBLINE_CHECK(p_world.size() == rays_cam.size(), "pose_linear needs as many points as rays");
  if (p_world.size() < 6) {
    return degenerate(
        fmt::format("{} points; the linear solution needs 6 that are not in a plane: add points, or use "
                    "pose_planar for a board and p3p for three points",
                    p_world.size()));
  }
  const auto start = solid_start(p_world, rays_cam);
  if (!start) return start.error();
  const detail::RaySighting s{{p_world.begin(), p_world.end()}, {rays_cam.begin(), rays_cam.end()}};
  // One is enough for 20 points; of 8, a DLT may be off by several of the pose's sigmas.
  constexpr int kSteps = 5;
  return detail::polish(s, *start, kSteps).T_cam_board;
}

Result<SE3> pose_from_points(const Lens& lens, std::span<const Vec3> p_board, std::span<const Vec2> px) {
  PLUMBLINE_CHECK(p_board.size() == px.size(), "pose_from_points needs as many points as pixels");
  const detail::RaySighting s = detail::unproject_all(lens, p_board, px);
  const std::size_t n = s.p_board.size();
  if (n < 4) {
    return degenerate(
        fmt::format("{} of {} pixels have a ray in lens {}; a pose needs 4 points of a plane or 6 in space: "
                    "show more of the board, or check the lens",
                    n, px.size(), lens_name(lens)));
  }
  const detail::Spread spread = detail::spread(detail::as_matrix(s.p_board));
  if (!(spread.sigma[1] >= detail::kFlat * spread.sigma[0]) || !(spread.sigma[0] > 0)) {
    return degenerate(
        fmt::format("the {} points seen lie on a line (width over length {:.2g}, at least {:.0e} is "
                    "needed); show more of the board",
                    n, spread.sigma[0] > 0 ? spread.sigma[1] / spread.sigma[0] : 0.0, detail::kFlat));
  }
  const double flatness = spread.flatness();
  if (flatness >= detail::kNearlyFlat && n < 6) {
    return degenerate(
        fmt::format("{} points that are not in a plane (thickness over extent {:.2g}) do not determine a "
                    "pose by DLT, which needs 6; show more of the target",
                    n, flatness));
  }
  std::vector<SE3> starts;
  std::optional<Error> refused;
  auto add = [&](const Result<SE3>& start) {
    if (start)
      starts.push_back(*start);
    else
      refused = start.error();
  };
  if (flatness >= kSolid && n >= 6) add(solid_start(s.p_board, s.rays_cam));
  // The best plane also serves a solid target whose DLT is degenerate: one face and a single point off it.
  if (flatness < detail::kNearlyFlat || starts.empty()) add(planar_start(s, spread));
  if (starts.empty()) return *refused;
  detail::PoseCandidate best{starts.front(), std::numeric_limits<double>::infinity()};
  for (const SE3& start : starts) {
    const detail::PoseCandidate candidate = detail::polish(s, start);
    if (candidate.cost < best.cost) best = candidate;
  }
  if (!std::isfinite(best.cost))
    return degenerate("no pose puts the points before the lens; check the points and the lens");
  return best.T_cam_board;
}

}  // namespace plumbline
