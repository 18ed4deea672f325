// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/relative_pose.hpp"

#include <fmt/format.h>

#include <cmath>
#include <optional>
#include <vector>

#include "plumbline/geometry/so3.hpp"
#include "refine/sampson_fit.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "refine_relative_pose";
using Vec5 = Eigen::Matrix<double, 5, 1>;
using Mat32 = Eigen::Matrix<double, 3, 2>;

struct State {
  Mat3 R;
  Vec3 t;  // unit

  Mat32 across() const {  // an orthonormal basis of the sphere's tangent plane at t
    Mat32 B;
    B.col(0) = t.unitOrthogonal();
    B.col(1) = t.cross(B.col(0));
    return B;
  }
  State plus(const Vec5& d) const {
    return {so3_exp(Vec3(d.head<3>())) * R, (t + across() * d.tail<2>()).normalized()};
  }
  Mat3 matrix() const {  // E
    return skew(t) * R;
  }
  // d vec(E) / d step, column-major.
  Eigen::Matrix<double, 9, 5> derivative() const {
    Eigen::Matrix<double, 9, 5> J;
    const Mat32 B = across();
    for (int k = 0; k < 3; ++k) J.col(k) = Mat3(skew(t) * skew(Vec3::Unit(k)) * R).reshaped();
    for (int k = 0; k < 2; ++k) J.col(3 + k) = Mat3(skew(B.col(k)) * R).reshaped();
    return J;
  }
};

std::optional<detail::MovingVector> lift(const Lens& lens, const Vec2& px) {
  const auto ray = unproject(lens, px);
  Mat23 J_px_ray;
  if (!ray || !project(lens, *ray, &J_px_ray)) return std::nullopt;
  // The pseudo-inverse moves the ray across itself.
  const Mat2 A = J_px_ray * J_px_ray.transpose();
  const Mat32 J = J_px_ray.transpose() * A.inverse();
  if (!J.allFinite()) return std::nullopt;
  return detail::MovingVector{*ray, J};
}

}  // namespace

Result<RefinedRelativePose> refine_relative_pose(const SE3& start_T_2_1, const Lens& lens_1,
                                                 const Lens& lens_2, std::span<const Vec2> px1,
                                                 std::span<const Vec2> px2, double sigma_px) {
  PLUMBLINE_CHECK(px1.size() == px2.size() && px1.size() >= 6,
                  "refine_relative_pose needs as many pixels in px1 as in px2, 6 or more");
  PLUMBLINE_CHECK(sigma_px > 0, "refine_relative_pose needs sigma_px > 0");
  const double baseline = start_T_2_1.t().norm();
  if (!(baseline > 0)) {
    return Error{ErrorCode::kInvalidData, "the start has no baseline; start from essential_ransac()", kWhere};
  }
  std::vector<detail::MovingVector> a, b;
  for (std::size_t i = 0; i < px1.size(); ++i) {
    const auto first = lift(lens_1, px1[i]), second = lift(lens_2, px2[i]);
    if (!first || !second) {
      return Error{ErrorCode::kInvalidData,
                   fmt::format("pair {} has a pixel outside the domain of lens {}; remove that pair", i,
                               first ? 2 : 1),
                   kWhere};
    }
    a.push_back(*first), b.push_back(*second);
  }
  const auto fit = detail::fit_sampson<5>(
      State{start_T_2_1.R(), start_T_2_1.t() / baseline}, a, b, sigma_px,
      {kWhere, "the relative pose undetermined: the camera only turned; move the camera between the views",
       "essential_ransac()"});
  if (!fit) return fit.error();
  Eigen::Matrix<double, 6, 5> J = Eigen::Matrix<double, 6, 5>::Zero();
  J.topLeftCorner<3, 3>().setIdentity();
  J.bottomRightCorner<3, 2>() = fit->state.across();
  RefinedRelativePose out;
  out.T_2_1 = SE3(fit->state.R, fit->state.t);
  out.covariance = J * fit->covariance * J.transpose();
  out.rms_px = fit->rms_px;
  out.iterations = fit->iterations;
  return out;
}

}  // namespace plumbline
