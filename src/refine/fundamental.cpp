// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/fundamental.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "plumbline/core/linalg.hpp"
#include "plumbline/geometry/so3.hpp"
#include "refine/sampson.hpp"
#include "refine/small_solve.hpp"

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

  Mat3 F() const { return U * Vec3(std::cos(p), std::sin(p), 0).asDiagonal() * V.transpose(); }

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

// Pixels scaled about their centroid to an RMS distance of sqrt(2).
struct Normalised {
  Mat3 T = Mat3::Identity();
  std::vector<detail::MovingVector> points;

  explicit Normalised(std::span<const Vec2> px) {
    Vec2 centre = Vec2::Zero();
    const double n = static_cast<double>(px.size());
    for (const Vec2& p : px) centre += p / n;
    double sum = 0;
    for (const Vec2& p : px) sum += (p - centre).squaredNorm();
    const double scale = sum > 0 ? std::sqrt(2 * n / sum) : 1.0;
    T << scale, 0, -scale * centre.x(), 0, scale, -scale * centre.y(), 0, 0, 1;
    for (const Vec2& p : px) {
      detail::MovingVector v{(scale * (p - centre)).homogeneous(), {}};
      v.J_v_px << scale, 0, 0, scale, 0, 0;
      points.push_back(v);
    }
  }
};

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
  const Normalised a(px1), b(px2);
  const auto evaluate = [&](const Orthonormal& state, detail::NormalEquations<7>& out) {
    const Mat3 F = state.F();
    const Mat97 J = state.derivative();
    for (std::size_t i = 0; i < a.points.size(); ++i) {
      const detail::SampsonTerm term = detail::sampson_term(F, a.points[i], b.points[i]);
      out.add<1>(Eigen::Matrix<double, 1, 1>(term.value / sigma_px),
                 Eigen::Matrix<double, 1, 7>(term.d_M.reshaped().transpose() * J / sigma_px));
    }
    return true;
  };
  const Mat3 normalised = b.T.inverse().transpose() * start * a.T.inverse();
  const auto solution = detail::solve_small<7>(Orthonormal(normalised), evaluate,
                                               [](const Orthonormal& s, const Vec7& d) { return s.plus(d); });
  const auto covariance = solution ? detail::spd_inverse<7>(solution->equations.A) : std::nullopt;
  if (solution && !covariance) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("the {} pairs leave the fundamental matrix undetermined: the scene is a plane or "
                    "the camera only turned; use a homography, or points at different depths",
                    px1.size()),
        kWhere};
  }
  if (!solution || !detail::is_settled(*solution, *covariance)) {
    return Error{
        ErrorCode::kNotConverged,
        fmt::format("no minimum of the Sampson distances of {} pairs was reached; remove outliers, or "
                    "start from fundamental_ransac()",
                    px1.size()),
        kWhere};
  }
  const Mat3 F = solution->state.F(), M = b.T.transpose() * F * a.T;
  const Mat97 J = solution->state.derivative();
  RefinedFundamental out;
  out.F = M / M.norm();
  out.covariance = denormalised_covariance(J * *covariance * J.transpose(), M, a.T, b.T);
  out.rms_px = sigma_px *
               std::sqrt(2 * solution->equations.cost / static_cast<double>(solution->equations.n_residuals));
  out.iterations = solution->iterations;
  return out;
}

}  // namespace plumbline
