// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "linear/ray_pose.hpp"
#include "plumbline/core/linalg.hpp"
#include "plumbline/linear/homography.hpp"
#include "plumbline/linear/pose.hpp"

namespace plumbline {
namespace {

Error degenerate(std::string text) { return {ErrorCode::kDegenerate, std::move(text), "pose of a board"}; }

// Both rotations and the translation of a plane whose homography onto rays is H, from H's derivative at the
// plane's origin. In a camera frame turned so that the origin lies along z, H ~ [r1 r2 (0, 0, distance)]: the
// derivative J of the image there is the upper 2x2 of [r1 r2] over the distance, whose larger singular value
// is 1. The third components follow from the lengths of r1 and r2, up to one common sign.
std::array<SE3, 2> infinitesimal_poses(const Mat3& H) {
  const Vec3 sight = H.col(2).normalized();
  const Mat3 R_turned_cam = Eigen::Quaterniond::FromTwoVectors(sight, Vec3::UnitZ()).toRotationMatrix();
  const Mat3 turned = R_turned_cam * H;
  const Mat2 J = turned.topLeftCorner<2, 2>() / turned(2, 2);
  // The larger singular value: |J|^2 = s1^2 + s2^2 and |det J| = s1 s2.
  const double squares = J.squaredNorm(), det = J.determinant();
  const double larger =
      std::sqrt(0.5 * (squares + std::sqrt(std::max(squares * squares - 4 * det * det, 0.0))));
  const double distance = 1 / larger;
  const Mat2 upper = J * distance, M = upper.transpose() * upper;
  Vec2 third(std::sqrt(std::max(1 - M(0, 0), 0.0)), std::sqrt(std::max(1 - M(1, 1), 0.0)));
  if (M(0, 1) > 0) third.y() = -third.y();  // r1 . r2 = 0
  std::array<SE3, 2> poses;
  for (int k = 0; k < 2; ++k) {
    Mat3 R;
    R.topLeftCorner<2, 2>() = upper;
    R.bottomLeftCorner<1, 2>() = (k == 0 ? 1 : -1) * third.transpose();
    R.col(2) = R.col(0).cross(R.col(1));
    poses[k] = SE3(R_turned_cam.transpose() * nearest_rotation(R), distance * sight);
  }
  return poses;
}

double rms_angle(const detail::PoseCandidate& c, std::size_t n) {
  // A chord of length c belongs to the angle 2 asin(c / 2).
  const double rms_chord = std::sqrt(c.cost / static_cast<double>(n));
  return 2 * std::asin(std::min(0.5 * rms_chord, 1.0));
}

}  // namespace

Result<PlanarPoses> pose_planar(std::span<const Vec3> p_board, std::span<const Vec3> rays_cam) {
  const std::size_t n = p_board.size();
  PLUMBLINE_CHECK(n == rays_cam.size(), "pose_planar needs as many points as rays");
  if (n < 4) return degenerate(fmt::format("{} points; the pose of a board needs 4: show more of it", n));
  const MatX points = detail::as_matrix(p_board);
  if (!points.allFinite() || !detail::as_matrix(rays_cam).allFinite()) {
    return Error{ErrorCode::kInvalidData, "a coordinate is not a finite number; remove that point",
                 "pose of a board"};
  }
  const detail::Spread spread = detail::spread(points);
  if (!(spread.sigma[0] > 0) || spread.sigma[1] < detail::kFlat * spread.sigma[0]) {
    return degenerate(
        fmt::format("the {} points lie on a line (width over length {:.2g}, at least {:.0e} is needed); show "
                    "more of the board",
                    n, spread.sigma[0] > 0 ? spread.sigma[1] / spread.sigma[0] : 0.0, detail::kFlat));
  }
  if (spread.flatness() > detail::kNearlyFlat) {
    return degenerate(fmt::format(
        "the {} points are not in a plane (thickness over extent {:.2g}, at most {} is allowed); use "
        "pose_linear",
        n, spread.flatness(), detail::kNearlyFlat));
  }
  const SE3 T_plane_board = detail::plane_frame(spread);
  std::vector<Vec2> a;
  for (const Vec3& p : p_board) a.push_back((T_plane_board * p).head<2>());
  const auto H = homography_to_rays(a, rays_cam);
  if (!H) return H.error();
  if (const auto edge_on = pose_from_homography(*H); !edge_on) return edge_on.error();
  const detail::RaySighting s{{p_board.begin(), p_board.end()}, {rays_cam.begin(), rays_cam.end()}};
  std::array<detail::PoseCandidate, 2> ends;
  const auto starts = infinitesimal_poses(*H);
  // Steps to the second minimum are slow: its residuals are not small.
  for (int k = 0; k < 2; ++k) ends[k] = detail::polish(s, starts[k] * T_plane_board, 60, 1e-12);
  if (ends[1].cost < ends[0].cost) std::swap(ends[0], ends[1]);
  PlanarPoses poses{{ends[0].T_cam_board, rms_angle(ends[0], n)}, std::nullopt};
  const Mat3 R_between = ends[0].T_cam_board.R().transpose() * ends[1].T_cam_board.R();
  // Polishing resolves a flat minimum to the square root of rounding; two minima nearer than that are one.
  if ((R_between - Mat3::Identity()).norm() > 1e-5) {
    poses.other = PlanarPose{ends[1].T_cam_board, rms_angle(ends[1], n)};
  }
  return poses;
}

}  // namespace plumbline
