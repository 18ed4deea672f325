// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "linear/consensus.hpp"
#include "linear/dlt.hpp"
#include "plumbline/core/linalg.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/linear/p3p.hpp"
#include "plumbline/linear/pose.hpp"

namespace plumbline {
namespace {

constexpr int kSample = 3;
// A pose is refused when more than this many as good are expected by chance.
constexpr double kMostByChance = 0.05;

Error degenerate(std::string text) { return {ErrorCode::kDegenerate, std::move(text), "pose"}; }

// The correspondences that can be inliers, with their places in the caller's lists.
struct Usable {
  std::vector<Vec3> p_world;
  std::vector<Vec2> px;
  std::vector<Vec3> rays_cam;
  std::vector<std::size_t> index;
};

Usable usable_of(const Lens& lens, std::span<const Vec3> p_world, std::span<const Vec2> px) {
  Usable u;
  for (std::size_t i = 0; i < px.size(); ++i) {
    if (!p_world[i].allFinite()) continue;
    const auto ray = unproject(lens, px[i]);
    if (!ray) continue;
    u.p_world.push_back(p_world[i]);
    u.px.push_back(px[i]);
    u.rays_cam.push_back(*ray);
    u.index.push_back(i);
  }
  return u;
}

std::optional<Error> refuse_line(std::span<const Vec3> points, const char* which) {
  const detail::Spread s = detail::spread(detail::as_matrix(points));
  if (s.sigma[0] > 0 && s.sigma[1] >= detail::kFlat * s.sigma[0]) return std::nullopt;
  return degenerate(fmt::format(
      "the {} {} lie on a line (width over length {:.2g}, at least {:.0e} is needed), about which "
      "the camera could turn; add points beside it",
      points.size(), which, s.sigma[0] > 0 ? s.sigma[1] / s.sigma[0] : 0.0, detail::kFlat));
}

// A few Gauss-Newton steps on the pixels of the inliers.
std::optional<SE3> refit(const Lens& lens, const Usable& u, SE3 T, std::span<const int> inliers) {
  return std::visit(
      [&](const auto& l) -> std::optional<SE3> {
        for (int iteration = 0; iteration < 3; ++iteration) {
          const Mat3 R = T.R();
          const Vec3 t = T.t();
          Mat6 A = Mat6::Zero();
          Vec6 b = Vec6::Zero();
          for (const int i : inliers) {
            const Vec3 Rp = R * u.p_world[i];
            Mat23 J_px_p;
            const auto px = l.project(Rp + t, &J_px_p);
            if (!px) continue;
            Mat26 J;
            J << -J_px_p * skew(Rp), J_px_p;
            A.noalias() += J.transpose() * J;
            b.noalias() += J.transpose() * (u.px[i] - *px);
          }
          const auto step = solve_spd(A, b);
          if (!step) return std::nullopt;
          T = box_plus(T, Vec6(*step));
        }
        return T;
      },
      lens);
}

double log_choose(double n, double k) {
  return std::lgamma(n + 1) - std::lgamma(k + 1) - std::lgamma(n - k + 1);
}

// The expected number of drawn poses that as many pixels, scattered at random over the area that the pixels
// span, would agree with: the number of false alarms of Moisan & Stival (2004). A sample agrees with its own.
double chance_poses(const Usable& u, const Consensus& c, double inlier_px) {
  Vec2 low = u.px.front(), high = low;
  for (const Vec2& px : u.px) low = low.cwiseMin(px), high = high.cwiseMax(px);
  const Vec2 size = (high - low).array() + 2 * inlier_px;
  const double p = std::min(1.0, std::numbers::pi * inlier_px * inlier_px / size.prod());
  const double n = static_cast<double>(u.px.size()), k = c.n_inliers;
  const double log_tested = std::min(std::log(c.n_hypotheses), log_choose(n, kSample)) + std::log(4.0);
  return std::exp(log_tested + log_choose(n - kSample, k - kSample) + (k - kSample) * std::log(p));
}

// The consensus in the caller's numbering.
Consensus spread_out(const Consensus& c, const Usable& u, std::size_t n) {
  Consensus all = c;
  all.inlier.assign(n, false);
  for (std::size_t k = 0; k < u.index.size(); ++k) all.inlier[u.index[k]] = c.inlier[k];
  return all;
}

}  // namespace

Result<Found<SE3>> pose_ransac(const Lens& lens, std::span<const Vec3> p_world, std::span<const Vec2> px,
                               const RansacOptions& options) {
  PLUMBLINE_CHECK(p_world.size() == px.size(), "pose_ransac needs as many points as pixels");
  detail::check_options(options);
  const Usable u = usable_of(lens, p_world, px);
  const int n = static_cast<int>(u.px.size());
  if (n < kSample + 1) {
    return degenerate(fmt::format(
        "{} of {} correspondences have a ray in lens {}; a pose needs 4, three that give it and one "
        "that confirms it: add points, or check the lens",
        n, px.size(), lens_name(lens)));
  }
  if (const auto e = refuse_line(u.p_world, "points")) return *e;
  const auto solve = [&](std::span<const int> sample, std::vector<SE3>& out) {
    std::array<Vec3, 3> p, rays;
    for (int k = 0; k < kSample; ++k) p[k] = u.p_world[sample[k]], rays[k] = u.rays_cam[sample[k]];
    for (const SE3& T : p3p(p, rays)) out.push_back(T);
  };
  const auto errors = [&](const SE3& T, int first, std::span<double> e2) {
    const Mat3 R = T.R();
    const Vec3 t = T.t();
    std::visit(
        [&](const auto& l) {
          for (std::size_t k = 0; k < e2.size(); ++k) {
            const std::size_t i = static_cast<std::size_t>(first) + k;
            const auto q = l.project(R * u.p_world[i] + t);
            e2[k] = q ? (*q - u.px[i]).squaredNorm() : std::numeric_limits<double>::infinity();
          }
        },
        lens);
  };
  auto found = detail::find_consensus<SE3>(
      n, kSample, options, solve, errors,
      [&](const SE3& T, std::span<const int> inliers) { return refit(lens, u, T, inliers); });
  if (!found || found->consensus.n_inliers < kSample + 1) {
    return degenerate(
        fmt::format("no pose brings 4 of {} correspondences within {} px of their pixels: they do not belong "
                    "together; check the order of the points, the lens, or allow more than {} px",
                    n, options.inlier_px, options.inlier_px));
  }
  std::vector<Vec3> agreed;
  for (const int i : detail::inlier_indices(found->consensus)) agreed.push_back(u.p_world[i]);
  if (const auto e = refuse_line(agreed, "points that agree")) return *e;
  if (const double chance = chance_poses(u, found->consensus, options.inlier_px); chance > kMostByChance) {
    return degenerate(
        fmt::format("{} of {} correspondences agree within {} px, and {:.2g} poses among the {} tried would "
                    "by chance (at "
                    "most {} are allowed); add correct correspondences, or lower the limit",
                    found->consensus.n_inliers, n, options.inlier_px, chance, found->consensus.n_hypotheses,
                    kMostByChance));
  }
  found->consensus = spread_out(found->consensus, u, px.size());
  return std::move(*found);
}

}  // namespace plumbline
