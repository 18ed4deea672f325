// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/essential.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "linear/degeneracy.hpp"
#include "linear/dlt.hpp"
#include "linear/minimal.hpp"
#include "linear/pixel_pairs.hpp"
#include "plumbline/core/linalg.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline {
namespace {

std::optional<Error> refuse_rays(std::span<const Vec3> rays_1, std::span<const Vec3> rays_2,
                                 const char* where) {
  for (std::size_t i = 0; i < rays_1.size(); ++i) {
    if (!rays_1[i].allFinite() || !rays_2[i].allFinite() || rays_1[i].isZero(0) || rays_2[i].isZero(0)) {
      return Error{ErrorCode::kInvalidData,
                   fmt::format("pair {} has a ray that is zero or not a finite number; remove that pair", i),
                   where};
    }
  }
  return std::nullopt;
}

// The nearest essential matrix, |E| = sqrt(2).
Mat3 with_equal_singular_values(const Mat3& E) {
  const Svd3 d = svd3(E);
  return d.U * Vec3(1, 1, 0).asDiagonal() * d.V.transpose();
}

// Of rays, in thousandths of a radian.
constexpr double kRoundingPx = 1e-6;

// Rays whose pixels are a thousandth of a radian.
std::vector<detail::Lifted> lift_rays(std::span<const Vec3> rays) {
  constexpr double kRadPerPx = 1e-3;
  std::vector<detail::Lifted> out;
  for (const Vec3& ray : rays) {
    out.push_back(detail::lift_ray(ray));
    out.back().J_v_px *= kRadPerPx;
    out.back().J_px_v /= kRadPerPx;
  }
  return out;
}

// E from rays that a linear map has widened.
detail::EightPoint eight_point(std::span<const Vec3> rays_1, std::span<const Vec3> rays_2) {
  const Mat3 T1 = detail::prepare_rays(rays_1).T, T2 = detail::prepare_rays(rays_2).T;
  std::vector<detail::Lifted> a(rays_1.size()), b(rays_2.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    a[i].v = T1 * rays_1[i].normalized();
    b[i].v = T2 * rays_2[i].normalized();
  }
  detail::EightPoint out = detail::eight_point(a, b);
  out.F = T2.transpose() * out.F * T1;
  return out;
}

}  // namespace

Result<std::vector<Mat3>> essential_5point(std::span<const Vec3> rays_1, std::span<const Vec3> rays_2) {
  constexpr const char* kWhere = "essential_5point";
  PLUMBLINE_CHECK(rays_1.size() == 5 && rays_2.size() == 5, "essential_5point needs five pairs");
  if (const auto e = refuse_rays(rays_1, rays_2, kWhere)) return *e;
  std::array<Vec3, 5> a, b;
  for (std::size_t i = 0; i < 5; ++i) a[i] = rays_1[i], b[i] = rays_2[i];
  Mat3 moment = Mat3::Zero();
  for (std::size_t i = 0; i < 5; ++i) moment += b[i].normalized() * a[i].normalized().transpose();
  const Mat3 R = nearest_rotation(moment);
  double parallax = 0;
  for (std::size_t i = 0; i < 5; ++i) {
    parallax = std::max(parallax, (R * a[i].normalized() - b[i].normalized()).norm());
  }
  if (parallax < detail::kRankTolerance) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("the camera only turned: a rotation explains the five pairs (parallax {:.2g} rad, at "
                    "least {:.0e} is needed); move the camera between the views",
                    parallax, detail::kRankTolerance),
        kWhere};
  }
  const detail::Answers<10> answers = detail::five_point(a, b);
  if (!(answers.determinacy > detail::kRankTolerance)) {
    return Error{ErrorCode::kDegenerate,
                 fmt::format("the five pairs give dependent equations (ratio {:.2g}, at least {:.0e} is "
                             "needed): two pairs are the same; use other pairs",
                             answers.determinacy, detail::kRankTolerance),
                 kWhere};
  }
  return std::vector<Mat3>(answers.matrix.begin(), answers.matrix.begin() + answers.n);
}

Result<Mat3> essential_8point(std::span<const Vec3> rays_1, std::span<const Vec3> rays_2) {
  constexpr const char* kWhere = "essential_8point";
  PLUMBLINE_CHECK(rays_1.size() == rays_2.size() && rays_1.size() >= 8,
                  "essential_8point needs as many rays_1 as rays_2, 8 or more");
  if (const auto e = refuse_rays(rays_1, rays_2, kWhere)) return *e;
  const detail::EightPoint solution = eight_point(rays_1, rays_2);
  const Mat3 E = with_equal_singular_values(solution.F);
  if (!solution.is_clear(rays_1.size())) {
    const auto a = lift_rays(rays_1), b = lift_rays(rays_2);
    // Equal singular values would leave residuals in the null space of a plane, where E is any [t]_x H.
    const TwoViewComparison c = detail::compare(detail::with_rank_2(solution.F), a, b, kRoundingPx,
                                                [&](const Mat3& H, std::span<const int> on) {
                                                  return detail::is_ray_turn(H, a, b, on, kRoundingPx);
                                                });
    if (c.kind != TwoViewDegeneracy::kNone) return Error{ErrorCode::kDegenerate, c.text(), kWhere};
  }
  if (!(solution.determinacy > detail::kRankTolerance)) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("more than one essential matrix fits the {} pairs (singular value ratio {:.2g}, at "
                    "least {:.0e} is needed); add points at different depths",
                    rays_1.size(), solution.determinacy, detail::kRankTolerance),
        kWhere};
  }
  return E;
}

std::array<SE3, 4> decompose_essential(const Mat3& E) {
  const Svd3 d = svd3(E);
  Mat3 W;
  W << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  const auto rotation = [&](const Mat3& M) -> Mat3 {
    const Mat3 R = d.U * M * d.V.transpose();
    return R.determinant() < 0 ? Mat3(-R) : R;
  };
  const Mat3 Ra = rotation(W), Rb = rotation(W.transpose());
  const Vec3 t = d.U.col(2);
  return {SE3(Ra, t), SE3(Ra, -t), SE3(Rb, t), SE3(Rb, -t)};
}

namespace {

// Sums of the weights for and against.
struct Vote {
  double yes = 0, no = 0;
  void add(double weight) { (weight > 0 ? yes : no) += std::abs(weight); }
  double clarity() const { return std::max(yes, no) / std::max(std::min(yes, no), 1e-300); }
};

Error undecided(const char* what, const Vote& vote) {
  return {ErrorCode::kDegenerate,
          fmt::format("{}: the better answer has only {:.2f} times the weight of the worse (at least 2 is "
                      "needed); use more pairs with parallax, or fewer outliers",
                      what, vote.clarity()),
          "relative_pose_from_essential"};
}

}  // namespace

Result<RelativePose> relative_pose_from_essential(const Mat3& E, std::span<const Vec3> rays_1,
                                                  std::span<const Vec3> rays_2) {
  PLUMBLINE_CHECK(rays_1.size() == rays_2.size() && !rays_1.empty(),
                  "relative_pose_from_essential needs as many rays_1 as rays_2, one or more");
  constexpr double kClear = 2;
  const std::array<SE3, 4> four = decompose_essential(E);
  const Vec3 t = four[0].t();
  Vote first;
  const Mat3 Ra = four[0].R();
  for (std::size_t i = 0; i < rays_1.size(); ++i) {
    first.add(t.cross(Ra * rays_1[i]).dot(t.cross(rays_2[i])));
  }
  if (!(first.clarity() >= kClear)) {
    return undecided("the rays do not tell which of the two rotations is right", first);
  }
  const Mat3 R = first.yes > first.no ? Ra : four[2].R();
  Vote forward;
  for (std::size_t i = 0; i < rays_1.size(); ++i) {
    // l1 a + t = l2 b, so both (a x b) l1 = b x t and (a x b) l2 = a x t.
    const Vec3 a = R * rays_1[i], toward = a.cross(t).normalized() + rays_2[i].cross(t).normalized();
    const double weight = a.cross(rays_2[i]).dot(toward);
    if (std::isfinite(weight)) forward.add(weight);
  }
  if (!(forward.clarity() >= kClear)) {
    return undecided("the parallax does not tell the direction of the baseline from its opposite", forward);
  }
  RelativePose out;
  out.T_2_1 = SE3(R, forward.yes > forward.no ? t : Vec3(-t));
  out.E = essential_from_pose(out.T_2_1);
  for (std::size_t i = 0; i < rays_1.size(); ++i) {
    const Vec3 a = R * rays_1[i], normal = a.cross(rays_2[i]), s = out.T_2_1.t();
    out.in_front.push_back(normal.dot(rays_2[i].cross(s)) > 0 && normal.dot(a.cross(s)) > 0);
    out.n_in_front += out.in_front.back();
  }
  return out;
}

}  // namespace plumbline
