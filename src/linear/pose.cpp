// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/pose.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "linear/dlt.hpp"
#include "plumbline/core/linalg.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/linear/camera_matrix.hpp"
#include "plumbline/linear/homography.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "pose";
// Points thinner than this fraction of their extent also start from the homography of their best plane: it is
// exact for a flat board, and for a bowed one it is a better start than a DLT that lives on the bow.
constexpr double kNearlyFlat = 0.05;
// Points thicker than this also start from a DLT.
constexpr double kSolid = 1e-3;

Error degenerate(std::string text) { return {ErrorCode::kDegenerate, std::move(text), kWhere}; }

// The points a lens can see, with their rays.
struct Sighting {
  std::vector<Vec3> p_board;
  std::vector<Vec3> rays_cam;
};

// Sum of squared chords between the unit rays and the unit directions of T p: it grows all the way to 180
// degrees.
double cost(const Sighting& s, const SE3& T_cam_board) {
  const Mat3 R = T_cam_board.R();
  const Vec3 t = T_cam_board.t();
  double sum = 0;
  for (std::size_t i = 0; i < s.p_board.size(); ++i) {
    sum += ((R * s.p_board[i] + t).normalized() - s.rays_cam[i]).squaredNorm();
  }
  return std::isfinite(sum) ? sum : std::numeric_limits<double>::infinity();
}

// The Gauss-Newton step of cost() in the coordinates of box_plus.
std::optional<Vec6> gauss_newton_step(const Sighting& s, const SE3& T_cam_board) {
  const Mat3 R = T_cam_board.R();
  const Vec3 t = T_cam_board.t();
  Mat6 A = Mat6::Zero();
  Vec6 b = Vec6::Zero();
  for (std::size_t i = 0; i < s.p_board.size(); ++i) {
    const Vec3 Rp = R * s.p_board[i], q = Rp + t;
    const double distance = q.norm();
    if (!(distance > 0)) return std::nullopt;
    const Vec3 u = q / distance;
    const Mat3 J_u_q = (Mat3::Identity() - u * u.transpose()) / distance;
    Eigen::Matrix<double, 3, 6> J;
    J << -J_u_q * skew(Rp), J_u_q;
    A += J.transpose() * J;
    b += J.transpose() * (s.rays_cam[i] - u);
  }
  const auto step = solve_spd(A, b);
  if (!step) return std::nullopt;
  return Vec6(*step);
}

struct Candidate {
  SE3 T_cam_board;
  double cost = 0;
};

Candidate polish(const Sighting& s, const SE3& start) {
  Candidate best{start, cost(s, start)};
  for (int iteration = 0; iteration < 15; ++iteration) {
    const auto full = gauss_newton_step(s, best.T_cam_board);
    if (!full) break;
    Vec6 step = *full;
    bool better = false;
    for (int halving = 0; halving < 8 && !better; ++halving, step *= 0.5) {
      const SE3 trial = box_plus(best.T_cam_board, step);
      const double trial_cost = cost(s, trial);
      if (!(trial_cost < best.cost)) continue;
      better = true;
      best = {trial, trial_cost};
    }
    if (!better || full->norm() < 1e-14 * (1 + best.T_cam_board.t().norm())) break;
  }
  return best;
}

// From the homography of the points' best plane, in the frame of that plane. The other pose, which mirrors a
// small board's normal at the line of sight, is not tried: over 27 000 random views of a 12 cm board at 1 to
// 8 m with 0.1 to 1 px of noise, trying it too changed one.
Result<SE3> planar_start(const Sighting& s, const detail::Spread& spread) {
  Mat3 axes = spread.axes;
  if (axes.determinant() < 0) axes.col(2) *= -1;
  const SE3 T_plane_board(axes.transpose(), -axes.transpose() * Vec3(spread.centroid));
  std::vector<Vec2> a;
  for (const Vec3& p : s.p_board) a.push_back((T_plane_board * p).head<2>());
  const auto H = homography_to_rays(a, s.rays_cam);
  if (!H) return H.error();
  const auto T_cam_plane = pose_from_homography(*H);
  if (!T_cam_plane) return T_cam_plane.error();
  return *T_cam_plane * T_plane_board;
}

Result<SE3> solid_start(const Sighting& s) {
  const auto P = camera_matrix_to_rays(s.p_board, s.rays_cam);
  if (!P) return P.error();
  const Mat3 M = P->leftCols<3>();
  if (M.determinant() < 0) {
    return degenerate(
        "the rays see a mirror image of the points (det R < 0); check the order and the axes of the points");
  }
  const Svd3 d = svd3(M);
  return SE3(d.U * d.V.transpose(), P->col(3) / d.s.mean());
}

Sighting unproject_all(const Lens& lens, std::span<const Vec3> p_board, std::span<const Vec2> px) {
  Sighting s;
  for (std::size_t i = 0; i < px.size(); ++i) {
    if (!p_board[i].allFinite()) continue;
    if (const auto ray = unproject(lens, px[i])) {
      s.p_board.push_back(p_board[i]);
      s.rays_cam.push_back(*ray);
    }
  }
  return s;
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

Result<SE3> pose_from_points(const Lens& lens, std::span<const Vec3> p_board, std::span<const Vec2> px) {
  PLUMBLINE_CHECK(p_board.size() == px.size(), "pose_from_points needs as many points as pixels");
  const Sighting s = unproject_all(lens, p_board, px);
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
  if (flatness >= kNearlyFlat && n < 6) {
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
  if (flatness >= kSolid && n >= 6) add(solid_start(s));
  // The best plane also serves a solid target whose DLT is degenerate: one face and a single point off it.
  if (flatness < kNearlyFlat || starts.empty()) add(planar_start(s, spread));
  if (starts.empty()) return *refused;
  Candidate best{starts.front(), std::numeric_limits<double>::infinity()};
  for (const SE3& start : starts) {
    const Candidate candidate = polish(s, start);
    if (candidate.cost < best.cost) best = candidate;
  }
  if (!std::isfinite(best.cost))
    return degenerate("no pose puts the points before the lens; check the points and the lens");
  return best.T_cam_board;
}

}  // namespace plumbline
