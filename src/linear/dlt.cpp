// SPDX-License-Identifier: Apache-2.0
#include "linear/dlt.hpp"

#include <algorithm>
#include <cmath>

#include "plumbline/core/linalg.hpp"

namespace plumbline::detail {
namespace {

// Rotation that takes the unit vector v to the z axis, the shortest way.
Mat3 turn_to_z(const Vec3& v) {
  if (v.z() < 0) {  // first half a turn about x, so that the formula below stays away from its pole at v = -z
    const Vec3 d(1, -1, -1);
    return turn_to_z(d.asDiagonal() * v) * d.asDiagonal();
  }
  const double k = 1 / (1 + v.z());
  Mat3 R;
  R << 1 - k * v.x() * v.x(), -k * v.x() * v.y(), -v.x(),  //
      -k * v.x() * v.y(), 1 - k * v.y() * v.y(), -v.y(),   //
      v.x(), v.y(), v.z();
  return R;
}

}  // namespace

double Spread::flatness() const { return sigma[0] > 0 ? sigma[sigma.size() - 1] / sigma[0] : 0.0; }

Spread spread(const MatX& points) {
  const Eigen::Index d = points.rows(), n = points.cols();
  Spread s;
  s.centroid = points.rowwise().mean();
  const MatX centred = points.colwise() - s.centroid;
  const SymEigen eigen = sym_eigen(centred * centred.transpose() / static_cast<double>(n));
  s.sigma = eigen.values.reverse().cwiseMax(0.0).cwiseSqrt();
  s.axes = eigen.vectors.rowwise().reverse();
  s.leverage = 1;
  if (s.sigma[d - 1] > 0) {
    const MatX scaled = s.sigma.cwiseInverse().asDiagonal() * (s.axes.transpose() * centred);
    s.leverage = (1 + scaled.colwise().squaredNorm().maxCoeff()) / static_cast<double>(n);
  }
  return s;
}

MatX normalising_similarity(const Spread& s) {
  const Eigen::Index d = s.centroid.size();
  const double rms = s.sigma.norm(), scale = rms > 0 ? std::sqrt(static_cast<double>(d)) / rms : 1.0;
  MatX T = MatX::Zero(d + 1, d + 1);
  T.topLeftCorner(d, d).diagonal().setConstant(scale);
  T.topRightCorner(d, 1) = -scale * s.centroid;
  T(d, d) = 1;
  return T;
}

MatX to_homogeneous(const MatX& T, const MatX& points) {
  const Eigen::Index d = points.rows();
  MatX result = MatX::Ones(d + 1, points.cols());
  result.topRows(d) = (T.topLeftCorner(d, d) * points).colwise() + VecX(T.topRightCorner(d, 1));
  return result;
}

MatX as_matrix(std::span<const Vec2> points) {
  MatX m(2, static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) m.col(static_cast<Eigen::Index>(i)) = points[i];
  return m;
}

MatX as_matrix(std::span<const Vec3> points) {
  MatX m(3, static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) m.col(static_cast<Eigen::Index>(i)) = points[i];
  return m;
}

PreparedRays prepare_rays(std::span<const Vec3> rays) {
  PreparedRays out;
  out.rays = as_matrix(rays);
  out.rays.colwise().normalize();
  const Vec3 mean = out.rays.rowwise().mean();
  // Rays all around have no mean direction and are well spread as they are.
  out.T = mean.norm() > 0.1 ? turn_to_z(mean.normalized()) : Mat3::Identity();
  out.rays = out.T * out.rays;
  const double across = out.rays.topRows(2).squaredNorm(), along = out.rays.row(2).squaredNorm();
  const double widen = across > 0 ? std::clamp(std::sqrt(2 * along / across), 1.0, 1e6) : 1.0;
  const Vec3 scale(widen, widen, 1);
  out.T = scale.asDiagonal() * out.T;
  out.rays = scale.asDiagonal() * out.rays;
  out.rays.colwise().normalize();
  const VecX moments = sym_eigen(out.rays * out.rays.transpose()).values;
  out.flatness = std::sqrt(std::max(moments[0], 0.0) / moments[2]);
  return out;
}

std::vector<Mat23> pixel_constraints(const MatX& b_homogeneous) {
  std::vector<Mat23> E(static_cast<std::size_t>(b_homogeneous.cols()));
  for (std::size_t i = 0; i < E.size(); ++i) {
    const Vec3 b = b_homogeneous.col(static_cast<Eigen::Index>(i));
    E[i] << b.z(), 0, -b.x(), 0, b.z(), -b.y();
  }
  return E;
}

std::vector<Mat23> ray_constraints(const MatX& rays) {
  std::vector<Mat23> E(static_cast<std::size_t>(rays.cols()));
  // The first two rows of a rotation that takes the ray to z span the plane across it.
  for (std::size_t i = 0; i < E.size(); ++i)
    E[i] = turn_to_z(rays.col(static_cast<Eigen::Index>(i))).topRows<2>();
  return E;
}

double DltSolution::determinacy() const {
  const double largest = singular_values[0];
  return largest > 0 ? singular_values[singular_values.size() - 2] / largest : 0.0;
}

DltSolution solve_dlt(const MatX& a, std::span<const Mat23> E) {
  const Eigen::Index k = a.rows(), n = a.cols();
  MatX A(2 * n, 3 * k);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < 3; ++j) {
      A.block(2 * i, j * k, 2, k) = E[static_cast<std::size_t>(i)].col(j) * a.col(i).transpose();
    }
  }
  const NullVector null = null_vector(A);
  return {Eigen::Map<const MatX>(null.v.data(), k, 3).transpose(), null.singular_values};
}

}  // namespace plumbline::detail
