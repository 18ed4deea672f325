// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/pose.hpp"

#include <fmt/format.h>

#include <cmath>
#include <optional>
#include <vector>

#include "plumbline/core/linalg.hpp"
#include "plumbline/geometry/so3.hpp"
#include "refine/small_solve.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "pose refinement";
// Of normal equations scaled to a unit diagonal, whose entries are known to some n 1e-16: a smaller
// eigenvalue may be 0.
constexpr double kSingular = 1e-12;

using detail::NormalEquations;

// Residuals over sigma and their derivatives; false where a point leaves the lens' domain.
template <class L>
bool evaluate(const L& lens, std::span<const Vec3> p_world, std::span<const Vec2> px, double sigma_px,
              const SE3& T_cam_world, NormalEquations<6>& out) {
  const Mat3 R = T_cam_world.R();
  const Vec3 t = T_cam_world.t();
  const double weight = 1 / sigma_px;
  for (std::size_t i = 0; i < px.size(); ++i) {
    const Vec3 Rp = R * p_world[i];
    Mat23 J_px_p;
    const auto q = lens.project(Rp + t, &J_px_p);
    if (!q) return false;
    J_px_p *= weight;
    Mat26 J;
    // d(R p)/dw = -[R p]_x: each row of J_px_p times it is the cross product (R p) x row.
    J.row(0) << Rp.cross(J_px_p.row(0).transpose()).transpose(), J_px_p.row(0);
    J.row(1) << Rp.cross(J_px_p.row(1).transpose()).transpose(), J_px_p.row(1);
    out.add<2>(Vec2(weight * (*q - px[i])), J);
  }
  return true;
}

std::optional<Error> refuse_singular(const Mat6& A, std::size_t n) {
  Vec6 s;
  for (int i = 0; i < 6; ++i) s[i] = A(i, i) > 0 ? 1 / std::sqrt(A(i, i)) : 0.0;
  const double smallest = sym_eigen(s.asDiagonal() * A * s.asDiagonal()).values[0];
  if (smallest > kSingular && s.minCoeff() > 0) return std::nullopt;
  return Error{
      ErrorCode::kDegenerate,
      fmt::format("the {} points do not determine the pose (smallest eigenvalue of the scaled normal "
                  "equations {:.2g}, at least {:.0e} is needed): they lie on a line, or three of them "
                  "on a cylinder with the camera; add points elsewhere",
                  n, smallest, kSingular),
      kWhere};
}

Error not_seen(const SE3& start, const Lens& lens, std::span<const Vec3> p_world, std::span<const Vec2> px) {
  std::size_t first = px.size(), count = 0;
  for (std::size_t i = 0; i < px.size(); ++i) {
    if (px[i].allFinite() && p_world[i].allFinite() && project(lens, start * p_world[i])) continue;
    if (count++ == 0) first = i;
  }
  return {ErrorCode::kInvalidData,
          fmt::format(
              "{} of {} points (the first is number {}, counted from 0) are outside the domain of lens {} "
              "at the start, or not finite; leave them out, or start from pose_ransac",
              count, px.size(), first, lens_name(lens)),
          kWhere};
}

}  // namespace

Result<RefinedPose> refine_pose(const SE3& start, const Lens& lens, std::span<const Vec3> p_world,
                                std::span<const Vec2> px, double sigma_px) {
  PLUMBLINE_CHECK(p_world.size() == px.size(), "refine_pose needs as many points as pixels");
  PLUMBLINE_CHECK(sigma_px > 0 && std::isfinite(sigma_px), "refine_pose needs a sigma_px above 0");
  const std::size_t n = px.size();
  if (n < 3) {
    return Error{ErrorCode::kDegenerate, fmt::format("{} points; a pose needs 3: add points", n), kWhere};
  }
  // Around the points' centroid c, where turning and moving are not alike however far away the world's origin
  // is: T_cam_c = T_cam_world T_world_c.
  Vec3 c = Vec3::Zero();
  for (const Vec3& p : p_world) c += p / static_cast<double>(n);
  std::vector<Vec3> p_c;
  p_c.reserve(n);
  for (const Vec3& p : p_world) p_c.push_back(p - c);
  const auto solution = std::visit(
      [&](const auto& l) {
        return detail::solve_small<6>(
            start * SE3(Mat3::Identity(), c),
            [&](const SE3& T, NormalEquations<6>& out) { return evaluate(l, p_c, px, sigma_px, T, out); },
            box_plus);
      },
      lens);
  if (!solution) return not_seen(start, lens, p_world, px);
  const NormalEquations<6>& e = solution->equations;
  if (const auto singular = refuse_singular(e.A, n)) return *singular;
  if (!solution->converged) {
    return Error{ErrorCode::kNotConverged,
                 fmt::format("no minimum after {} steps (error {:.3g} px); start nearer to the answer",
                             solution->iterations, sigma_px * std::sqrt(2 * e.cost / static_cast<double>(n))),
                 kWhere};
  }
  RefinedPose refined;
  refined.T_cam_world = solution->state * SE3(Mat3::Identity(), -c);
  // t_world = t_c - R c, so that dt_world = dt_c + [R c]_x dw
  Mat6 J_world_c = Mat6::Identity();
  J_world_c.bottomLeftCorner<3, 3>() = skew(solution->state.R() * c);
  const auto covariance_c = detail::spd_inverse<6>(e.A);
  if (!covariance_c) return *refuse_singular(Mat6::Zero(), n);
  refined.covariance = J_world_c * *covariance_c * J_world_c.transpose();
  refined.rms_px = sigma_px * std::sqrt(2 * e.cost / static_cast<double>(n));
  refined.iterations = solution->iterations;
  return refined;
}

}  // namespace plumbline
