// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/homography.hpp"

#include <cmath>
#include <optional>
#include <vector>

#include "plumbline/core/check.hpp"
#include "refine/projective.hpp"
#include "refine/projective_result.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "refined homography";
using State = detail::RowVector3K<3>;

// Image of a point and its derivative by the point.
struct Image {
  Vec2 uv;
  double w;
  Mat2 D;
};

Image image(const Mat3& H, const Vec2& a) {
  const Vec3 x = H * a.homogeneous();
  Image out{x.hnormalized(), x.z(), {}};
  out.D = (H.topLeftCorner<2, 2>() - out.uv * H.bottomLeftCorner<1, 2>()) / out.w;
  return out;
}

struct Problem {
  std::vector<Vec2> a, b;         // normalised
  std::vector<bool> front;        // side of the horizon at the start
  double per_unit_a, per_unit_b;  // sigmas in a normalised unit
  HomographyNoise noise;

  bool sees(const Image& at, std::size_t i) const { return at.w != 0 && (at.w > 0) == front[i]; }

  // The point near a_i for which |a_i - a^|^2 + |b_i - H a^|^2, in sigmas, is least: Gauss-Newton from a_i,
  // which is Sampson's correction after one step.
  std::optional<Vec2> corrected(const Mat3& H, std::size_t i) const {
    constexpr int kMaxSteps = 20;
    constexpr double kSettled = 1e-24;  // sigmas, squared
    const double ka = per_unit_a * per_unit_a, kb = per_unit_b * per_unit_b;
    Vec2 point = a[i];
    for (int k = 0; k < kMaxSteps; ++k) {
      const Image at = image(H, point);
      if (!sees(at, i)) return std::nullopt;
      const Mat2 A = ka * Mat2::Identity() + kb * at.D.transpose() * at.D;
      const Vec2 step = A.inverse() * (kb * at.D.transpose() * (b[i] - at.uv) + ka * (a[i] - point));
      point += step;
      if (ka * step.squaredNorm() < kSettled) break;
    }
    return point;
  }

  bool operator()(const State& state, detail::NormalEquations<8>& out) const {
    const Mat3 H = detail::from_row_major<3>(state);
    const double ka = per_unit_a * per_unit_a, kb = per_unit_b * per_unit_b;
    detail::ProjectiveSums<3> sums;
    for (std::size_t i = 0; i < a.size(); ++i) {
      Vec2 point = a[i];
      if (noise == HomographyNoise::kBoth) {
        const auto best = corrected(H, i);
        if (!best) return false;
        point = *best;
      }
      const Image at = image(H, point);
      if (!sees(at, i)) return false;
      const Vec2 residual = at.uv - b[i];
      Mat2 W = kb * Mat2::Identity();
      // With the point eliminated: (1/kb + D D'/ka)^-1 is the Schur complement kb - kb D (ka + kb D'D)^-1 D'
      // kb.
      if (noise == HomographyNoise::kBoth)
        W = Mat2(Mat2::Identity() / kb + at.D * at.D.transpose() / ka).inverse();
      sums.add(point.homogeneous(), at.uv, at.w, W, kb * residual);
      out.cost += 0.5 * (kb * residual.squaredNorm() + ka * (point - a[i]).squaredNorm());
    }
    out.n_residuals = 2 * static_cast<int>(a.size());
    sums.write(detail::tangent_basis<9>(state), out);
    return true;
  }
};

}  // namespace

Result<RefinedHomography> refine_homography(const Mat3& start_H, std::span<const Vec2> a,
                                            std::span<const Vec2> b, double sigma_px, HomographyNoise noise) {
  PLUMBLINE_CHECK(a.size() == b.size() && a.size() >= 4,
                  "refine_homography needs as many points in a as in b, 4 or more");
  PLUMBLINE_CHECK(sigma_px > 0, "refine_homography needs sigma_px above 0");
  const detail::Similarity<2> Ta(a), Tb(b);
  Problem problem{Ta(a), Tb(b), {}, 1 / (Ta.scale * sigma_px), 1 / (Tb.scale * sigma_px), noise};
  const Mat3 Ta_inverse = Ta.matrix().inverse(), Tb_inverse = Tb.matrix().inverse();
  const State start = detail::row_major<3>(Tb.matrix() * start_H * Ta_inverse).normalized();
  const Mat3 start_n = detail::from_row_major<3>(start);
  for (const Vec2& p : problem.a) problem.front.push_back(start_n.row(2).dot(p.homogeneous()) > 0);
  const auto solution = detail::solve_small<8>(start, problem, detail::plus_on_sphere<9>);
  const auto covariance = detail::checked_covariance(solution, "homography", kWhere);
  if (!covariance) return covariance.error();
  const auto out = detail::denormalised<3>(solution->state, *covariance, Tb_inverse, Ta.matrix());
  return RefinedHomography{out.M.row(2).dot(a[0].homogeneous()) < 0 ? Mat3(-out.M) : out.M, out.covariance,
                           sigma_px * std::sqrt(2 * solution->equations.cost / static_cast<double>(a.size())),
                           solution->iterations};
}

}  // namespace plumbline
