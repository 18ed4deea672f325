// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/point.hpp"

#include <fmt/format.h>

#include <cmath>
#include <vector>

#include "refine/small_solve.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "point refinement";

}  // namespace

Result<Triangulated> refine_point(const Vec3& start_world, std::span<const PosedLens> cameras,
                                  std::span<const Vec2> px, double sigma_px) {
  PLUMBLINE_CHECK(cameras.size() == px.size(), "refine_point needs as many pixels as cameras");
  PLUMBLINE_CHECK(sigma_px > 0 && std::isfinite(sigma_px), "refine_point needs a sigma_px above 0");
  std::vector<Mat3> R;
  R.reserve(cameras.size());
  for (const PosedLens& camera : cameras) R.push_back(camera.T_cam_world.R());
  const auto solution = detail::solve_small<3>(
      start_world,
      [&](const Vec3& p, detail::NormalEquations<3>& out) {
        for (std::size_t i = 0; i < px.size(); ++i) {
          Mat23 J;
          const auto q = project(cameras[i].lens, R[i] * p + cameras[i].T_cam_world.t(), &J);
          if (!q) return false;
          out.add<2>(Vec2((*q - px[i]) / sigma_px), J * R[i] / sigma_px);
        }
        return true;
      },
      [](const Vec3& p, const Vec3& step) { return Vec3(p + step); });
  if (!solution) {
    return Error{ErrorCode::kInvalidData,
                 "a lens does not see the start, or a number is not finite; start from triangulate", kWhere};
  }
  if (!solution->converged) {
    return Error{ErrorCode::kNotConverged,
                 fmt::format("no minimum after {} steps; start nearer to the answer", solution->iterations),
                 kWhere};
  }
  auto refined = triangulated_at(solution->state, cameras, px, sigma_px);
  if (!refined) return refined.error();
  if (const auto covariance = detail::spd_inverse<3>(solution->equations.A))
    refined->covariance = *covariance;
  return refined;
}

}  // namespace plumbline
