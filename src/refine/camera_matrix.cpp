// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/camera_matrix.hpp"

#include <cmath>
#include <vector>

#include "plumbline/core/check.hpp"
#include "refine/projective.hpp"
#include "refine/projective_result.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "refined camera matrix";
using State = detail::RowVector3K<4>;

struct Problem {
  std::vector<Vec3> p;      // normalised
  std::vector<Vec2> x;      // normalised
  std::vector<bool> front;  // side of the principal plane at the start
  double per_unit;          // sigmas in a normalised unit

  bool operator()(const State& state, detail::NormalEquations<11>& out) const {
    const Mat34 P = detail::from_row_major<4>(state);
    const Mat2 W = per_unit * per_unit * Mat2::Identity();
    detail::ProjectiveSums<4> sums;
    for (std::size_t i = 0; i < p.size(); ++i) {
      const Vec4 X = p[i].homogeneous();
      const Vec3 image = P * X;
      if (image.z() == 0 || (image.z() > 0) != front[i]) return false;
      const Vec2 uv = image.hnormalized(), residual = uv - x[i];
      sums.add(X, uv, image.z(), W, W * residual);
      out.cost += 0.5 * per_unit * per_unit * residual.squaredNorm();
    }
    out.n_residuals = 2 * static_cast<int>(p.size());
    sums.write(detail::tangent_basis<12>(state), out);
    return true;
  }
};

}  // namespace

Result<RefinedCameraMatrix> refine_camera_matrix(const Mat34& start_P, std::span<const Vec3> p_world,
                                                 std::span<const Vec2> px, double sigma_px) {
  PLUMBLINE_CHECK(p_world.size() == px.size() && px.size() >= 6,
                  "refine_camera_matrix needs as many points as pixels, 6 or more");
  PLUMBLINE_CHECK(sigma_px > 0, "refine_camera_matrix needs sigma_px above 0");
  const detail::Similarity<3> TX(p_world);
  const detail::Similarity<2> Tx(px);
  Problem problem{TX(p_world), Tx(px), {}, 1 / (Tx.scale * sigma_px)};
  const Mat4 TX_inverse = TX.matrix().inverse();
  const Mat3 Tx_inverse = Tx.matrix().inverse();
  const State start = detail::row_major<4>(Tx.matrix() * start_P * TX_inverse).normalized();
  const Mat34 start_n = detail::from_row_major<4>(start);
  for (const Vec3& p : problem.p) problem.front.push_back(start_n.row(2).dot(p.homogeneous()) > 0);
  const auto solution = detail::solve_small<11>(start, problem, detail::plus_on_sphere<12>);
  const auto covariance = detail::checked_covariance(solution, "camera matrix", kWhere);
  if (!covariance) return covariance.error();
  const auto out = detail::denormalised<4>(solution->state, *covariance, Tx_inverse, TX.matrix());
  double depth = 0;
  for (const Vec3& p : p_world) depth += out.M.row(2).dot(p.homogeneous());
  return RefinedCameraMatrix{
      depth < 0 ? Mat34(-out.M) : out.M, out.covariance,
      sigma_px * std::sqrt(2 * solution->equations.cost / static_cast<double>(px.size())),
      solution->iterations};
}

}  // namespace plumbline
