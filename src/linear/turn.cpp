// SPDX-License-Identifier: Apache-2.0
// Which homographies are those of a camera that turned.
#include <algorithm>
#include <cmath>

#include "linear/degeneracy.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline::detail {
namespace {

// With det H = 1: trace H and trace H^-1.
Vec2 traces(const Mat3& H) {
  const double root = std::cbrt(H.determinant());
  return {H.trace() / root, H.inverse().trace() * root};
}

// Covariance of H's nine entries (column-major), up to the noise's variance: the pseudo-inverse of the normal
// equations of the pairs' Sampson errors.
MatX covariance_of(const Mat3& H, std::span<const Lifted> a, std::span<const Lifted> b,
                   std::span<const int> on) {
  MatX N = MatX::Zero(9, 9);
  for (const int i : on) {
    const Lifted &p = a[static_cast<std::size_t>(i)], &q = b[static_cast<std::size_t>(i)];
    const Mat23 J = q.J_px_v / q.measure.dot(H * p.v);
    const Mat2 M = J * (H * p.J_v_px);
    const Mat2 W = (Mat2::Identity() + M * M.transpose()).inverse();
    Eigen::Matrix<double, 2, 9> D;
    for (int c = 0; c < 3; ++c) D.middleCols<3>(3 * c) = p.v[c] * J;
    N += D.transpose() * W * D;
  }
  const SymEigen e = sym_eigen(N);
  VecX inverse = VecX::Zero(9);
  for (Eigen::Index k = 1; k < 9; ++k) inverse[k] = e.values[k] > 1e-12 * e.values[8] ? 1 / e.values[k] : 0.0;
  return e.vectors * inverse.asDiagonal() * e.vectors.transpose();
}

}  // namespace

bool is_turn(const Mat3& H, std::span<const Lifted> a, std::span<const Lifted> b, std::span<const int> on,
             const Mat3& T_common_1, const Mat3& T_common_2) {
  // The distance of K R K^-1 from the identity is at most f / s times that of R, in units s of the image's
  // RMS extent over sqrt(2); f / s = 8 is a lens of 25 degrees.
  constexpr double kLongestLens = 8, kSigmas = 4, kRounding = 1e-8;
  const Mat3 to_1 = T_common_1.inverse();
  const auto common = [&](const Mat3& M) { return Mat3(T_common_2 * M * to_1); };
  const Mat3 C = common(H);
  const double determinant = C.determinant();
  if (!(std::abs(determinant) > 1e-9 * std::pow(C.norm(), 3))) return false;
  const Vec2 t = traces(C);
  Eigen::Matrix<double, 9, 2> gradient;  // by central differences: both are smooth
  const double h = 1e-6 * H.norm();
  for (int k = 0; k < 9; ++k) {
    Mat3 up = H, down = H;
    up(k % 3, k / 3) += h, down(k % 3, k / 3) -= h;
    gradient.row(k) = ((traces(common(up)) - traces(common(down))) / (2 * h)).transpose();
  }
  const MatX cov = covariance_of(H, a, b, on);
  double sse = 0;
  for (const int i : on) {
    const auto k = static_cast<std::size_t>(i);
    sse += homography_sampson_squared(H, a[k], b[k]);
  }
  const double noise_px = std::sqrt(sse / std::max(1.0, 2.0 * static_cast<double>(on.size()) - 8));
  const Eigen::Matrix<double, 9, 1> difference = gradient.col(0) - gradient.col(1),
                                    mean = 0.5 * (gradient.col(0) + gradient.col(1));
  const auto sigma = [&](const Eigen::Matrix<double, 9, 1>& g) {
    return kSigmas * noise_px * std::sqrt(std::max(0.0, g.dot(VecX(cov * g)))) + kRounding;
  };
  if (std::abs(t.x() - t.y()) > sigma(difference)) return false;
  const double trace = 0.5 * (t.x() + t.y()), slack = sigma(mean);  // 1 + 2 cos(angle)
  if (trace > 3 + slack || trace < -1 - slack) return false;
  const double sine_half = std::sqrt(std::clamp((3 - trace + slack) / 4, 0.0, 1.0));
  const double distance = (C / std::cbrt(determinant) - Mat3::Identity()).norm();
  return distance <= kLongestLens * 2 * std::sqrt(2.0) * sine_half + kRounding;
}

bool is_ray_turn(const Mat3& H, std::span<const Lifted> a, std::span<const Lifted> b, std::span<const int> on,
                 double rounding_px) {
  Mat3 moment = Mat3::Zero();
  for (const int i : on) {
    moment += b[static_cast<std::size_t>(i)].v * a[static_cast<std::size_t>(i)].v.transpose();
  }
  const Mat3 R = nearest_rotation(moment);
  double sse_R = 0, sse_H = 0;
  for (const int i : on) {
    const auto k = static_cast<std::size_t>(i);
    sse_R += homography_sampson_squared(R, a[k], b[k]);
    sse_H += homography_sampson_squared(H, a[k], b[k]);
  }
  constexpr double kExtraDof = 5;  // eight of a homography, three of a rotation
  const double dof = std::max(1.0, 2.0 * static_cast<double>(on.size()) - 8);
  const double variance = std::max(sse_H / dof, rounding_px * rounding_px);
  return (sse_R - sse_H) / kExtraDof <= std::max(2.0, variance_ratio_limit(kExtraDof, dof)) * variance;
}

}  // namespace plumbline::detail
