// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "crosscheck/referee.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline::detail {
namespace {

// Stereographic coordinates u = 2 tan(theta/2) (x, y)/r of a unit ray, and back. mrcal's splined lens is a
// spline over u that is added to u: px = f (u + spline(u)) + c.
Vec2 stereographic(const Vec3& ray) { return 2 / (1 + ray.z()) * ray.head<2>(); }
Vec3 ray_of(const Vec2& u) {
  const double s = u.squaredNorm() / 4;
  return Vec3(u.x(), u.y(), 1 - s) / (1 + s);
}

constexpr int kKnotsAcross = 12;

// The projection is linear in the control points: one linear least-squares problem over samples of our lens.
void fit_control_points(RefereeLens& out, const Lens& lens, const Vec2& reach) {
  const int n = static_cast<int>(out.parameters.size()), n_free = n - 4;
  MatX A = MatX::Zero(n_free, n_free);
  VecX b = VecX::Zero(n_free);
  std::vector<double> gradient(2 * static_cast<std::size_t>(n));
  constexpr int kSamples = 60;
  for (int row = 0; row < kSamples; ++row) {
    for (int col = 0; col < kSamples; ++col) {
      const Vec2 u(reach.x() * (2.0 * col / (kSamples - 1) - 1),
                   reach.y() * (2.0 * row / (kSamples - 1) - 1));
      const Vec3 ray = ray_of(u);
      const auto wanted = project(lens, ray);
      if (!wanted) continue;
      mrcal_point3_t p{}, dq_dp[2]{};
      mrcal_point2_t px{};
      std::copy_n(ray.data(), 3, p.xyz);
      if (!mrcal_project(&px, dq_dp, gradient.data(), &p, 1, &out.model, out.parameters.data())) continue;
      for (int axis = 0; axis < 2; ++axis) {
        const double* g = &gradient[static_cast<std::size_t>(axis) * n + 4];
        std::vector<int> touched;
        for (int i = 0; i < n_free; ++i) {
          if (g[i] != 0) touched.push_back(i);
        }
        for (int i : touched) {
          for (int j : touched) A(i, j) += g[i] * g[j];
          b[i] += g[i] * ((*wanted)[axis] - px.xy[axis]);
        }
      }
    }
  }
  // A whiff of damping for control points that no sample touches; they stay at zero.
  const double damping = 1e-10 * A.trace() / n_free;
  A.diagonal().array() += damping;
  if (const auto x = solve_spd(A, b)) {
    for (int i = 0; i < n_free; ++i) out.parameters[4 + static_cast<std::size_t>(i)] = (*x)(i, 0);
  }
}

}  // namespace

std::optional<RefereeLens> fit_splined(const Camera& camera, const std::vector<Vec3>& rays_cam) {
  Vec2 reach = Vec2::Constant(1e-3);
  for (const Vec3& ray : rays_cam) reach = reach.cwiseMax(1.05 * stereographic(ray).cwiseAbs());
  // A cubic spline over kKnotsAcross knots covers all but 3 of the intervals; fov_x_deg is what it covers.
  const double fov_x_deg = std::ceil(4 * std::atan(0.5 * reach.x()) * 180 / std::numbers::pi);
  const double covered = 2 * std::tan(fov_x_deg / 4 * std::numbers::pi / 180);  // half of it, in u
  const int knots_down =
      std::max(5, static_cast<int>(std::ceil(reach.y() / covered * (kKnotsAcross - 3))) + 3);
  RefereeLens out;
  out.name = fmt::format("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx={}_Ny={}_fov_x_deg={:.0f}", kKnotsAcross,
                         knots_down, fov_x_deg);
  if (!mrcal_lensmodel_from_name(&out.model, out.name.c_str())) return std::nullopt;
  out.parameters.assign(static_cast<std::size_t>(mrcal_lensmodel_num_params(&out.model)), 0.0);
  std::copy_n(params(camera.lens).begin(), 4, out.parameters.begin());
  fit_control_points(out, camera.lens, Vec2(covered, reach.y()));
  return out;
}

}  // namespace plumbline::detail
