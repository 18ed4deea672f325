// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/fundamental.hpp"

#include <algorithm>
#include <vector>

#include "plumbline/core/linalg.hpp"
#include "plumbline/geometry/so3.hpp"
#include "refine/projective.hpp"
#include "refine/sampson_fit.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "refine_fundamental";
using Vec7 = Eigen::Matrix<double, 7, 1>;
using Mat97 = Eigen::Matrix<double, 9, 7>;
using Mat9 = Eigen::Matrix<double, 9, 9>;

// F = U diag(cos p, sin p, 0) V'.
struct Orthonormal {
  Mat3 U, V;
  double p;

  explicit Orthonormal(const Mat3& F) {
    const Svd3 d = svd3(F);
    U = d.U, V = d.V;
    // The third columns do not matter for F: they make both rotations.
    if (U.determinant() < 0) U.col(2) = -U.col(2);
    if (V.determinant() < 0) V.col(2) = -V.col(2);
    p = std::atan2(d.s[1], d.s[0]);
  }

  Mat3 matrix() const { return U * Vec3(std::cos(p), std::sin(p), 0).asDiagonal() * V.transpose(); }

  // d = [turn of U | turn of V | dp], each in its own frame.
  Orthonormal plus(const Vec7& d) const {
    Orthonormal out = *this;
    out.U = U * so3_exp(Vec3(d.head<3>()));
    out.V = V * so3_exp(Vec3(d.segment<3>(3)));
    out.p += d[6];
    return out;
  }

  // d vec(F) / d step, column-major.
  Mat97 derivative() const {
    const Mat3 S = Vec3(std::cos(p), std::sin(p), 0).asDiagonal();
    Mat97 J;
    const auto set = [&](int k, const Mat3& D) { J.col(k) = D.reshaped(); };
    for (int k = 0; k < 3; ++k) {
      set(k, U * skew(Vec3::Unit(k)) * S * V.transpose());
      set(3 + k, -U * S * skew(Vec3::Unit(k)) * V.transpose());
    }
    set(6, U * Vec3(-std::sin(p), std::cos(p), 0).asDiagonal() * V.transpose());
    return J;
  }
};

std::vector<detail::MovingVector> lifted(std::span<const Vec2> px, const detail::Similarity<2>& T) {
  std::vector<detail::MovingVector> out;
  for (const Vec2& p : T(px)) {
    detail::MovingVector v{p.homogeneous(), {}};
    v.J_v_px << T.scale, 0, 0, T.scale, 0, 0;
    out.push_back(v);
  }
  return out;
}

// Of the unit F' = M / |M|, M = T2' F T1, row after row, from the covariance of F, column after column.
Mat9 denormalised_covariance(const Mat9& covariance, const Mat3& M, const Mat3& T1, const Mat3& T2) {
  const double norm = M.norm();
  const Mat3 unit = M / norm;
  Mat9 J;
  for (int k = 0; k < 9; ++k) {
    Mat3 D = Mat3::Zero();
    D(k % 3, k / 3) = 1;
    D = T2.transpose() * D * T1 / norm;
    D -= unit.cwiseProduct(D).sum() * unit;
    J.col(k) = Mat3(D.transpose()).reshaped();
  }
  return J * covariance * J.transpose();
}

}  // namespace

Result<RefinedFundamental> refine_fundamental(const Mat3& start, std::span<const Vec2> px1,
                                              std::span<const Vec2> px2, double sigma_px) {
  PLUMBLINE_CHECK(px1.size() == px2.size() && px1.size() >= 8,
                  "refine_fundamental needs as many pixels in px1 as in px2, 8 or more");
  PLUMBLINE_CHECK(sigma_px > 0, "refine_fundamental needs sigma_px > 0");
  const auto finite = [](const Vec2& p) { return p.allFinite(); };
  if (!start.allFinite() || start.isZero(0) || !std::all_of(px1.begin(), px1.end(), finite) ||
      !std::all_of(px2.begin(), px2.end(), finite)) {
    return Error{ErrorCode::kInvalidData,
                 "a coordinate or the start is not a finite number, or the start is zero; remove that pair",
                 kWhere};
  }
  const detail::Similarity<2> similarity_1(px1), similarity_2(px2);
  const Mat3 T1 = similarity_1.matrix(), T2 = similarity_2.matrix();
  const Mat3 normalised = T2.inverse().transpose() * start * T1.inverse();
  const auto fit = detail::fit_sampson<7>(Orthonormal(normalised), lifted(px1, similarity_1),
                                          lifted(px2, similarity_2), sigma_px,
                                          {kWhere,
                                           "the fundamental matrix undetermined: the scene is a plane or the "
                                           "camera only turned; use a homography, or "
                                           "points at different depths",
                                           "fundamental_ransac()"});
  if (!fit) return fit.error();
  const Mat3 M = T2.transpose() * fit->state.matrix() * T1;
  const Mat97 J = fit->state.derivative();
  RefinedFundamental out;
  out.F = M / M.norm();
  out.covariance = denormalised_covariance(J * fit->covariance * J.transpose(), M, T1, T2);
  out.rms_px = fit->rms_px;
  out.iterations = fit->iterations;
  return out;
}

}  // namespace plumbline
