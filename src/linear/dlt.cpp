// SPDX-License-Identifier: Apache-2.0
#include "linear/dlt.hpp"

#include <algorithm>
#include <cmath>

#include "linear/normal_null.hpp"
#include "plumbline/core/check.hpp"
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
  MatX turned = as_matrix(rays);
  turned.colwise().normalize();
  const Vec3 mean = turned.rowwise().mean();
  // Rays all around have no mean direction and are well spread as they are.
  const Mat3 R = mean.norm() > 0.1 ? turn_to_z(mean.normalized()) : Mat3(Mat3::Identity());
  turned = R * turned;
  const double across = turned.topRows(2).squaredNorm(), along = turned.row(2).squaredNorm();
  const double widen = across > 0 ? std::clamp(std::sqrt(2 * along / across), 1.0, 1e6) : 1.0;
  PreparedRays out;
  out.T = Vec3(widen, widen, 1).asDiagonal() * R;
  for (Eigen::Index i = 0; i < turned.cols(); ++i) {
    // The first two rows of a rotation that takes the ray to z span the plane across it.
    out.E.push_back(turn_to_z(turned.col(i)).topRows<2>() * Vec3(1, 1, widen).asDiagonal());
  }
  const MatX wide = Vec3(widen, widen, 1).asDiagonal() * turned;
  const VecX moments = sym_eigen(wide * wide.transpose()).values;
  out.flatness = std::sqrt(std::max(moments[0], 0.0) / moments[2]);
  return out;
}

namespace {

// From the rows themselves, E_i's columns times a_i': for systems that are nearly of too small a rank.
DltSolution solve_dlt_by_svd(const MatX& a, std::span<const Mat23> E) {
  const Eigen::Index k = a.rows(), n = a.cols();
  MatX A(2 * n, 3 * k);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < 3; ++j) {
      A.block(2 * i, j * k, 2, k) = E[static_cast<std::size_t>(i)].col(j) * a.col(i).transpose();
    }
  }
  const NullVector null = null_vector(A);
  const double largest = null.singular_values[0], last_but_one = null.singular_values[3 * k - 2];
  return {Eigen::Map<const MatX>(null.v.data(), k, 3).transpose(),
          largest > 0 ? last_but_one / largest : 0.0};
}

// A'A of those rows is made of the blocks  sum (E'E)(r, c) a a', and A'A h of  sum a (E'E H a)'.
template <int K>
DltSolution solve_dlt_of(const MatX& a, std::span<const Mat23> E) {
  using VecK = Eigen::Matrix<double, K, 1>;
  using Moments = Eigen::Matrix<double, K*(K + 1) / 2, 6>;
  constexpr int N = 3 * K;
  const auto point = [&](std::size_t i) {
    return Eigen::Map<const VecK>(a.data() + K * static_cast<Eigen::Index>(i));
  };
  Moments sums = Moments::Zero();
  for (std::size_t i = 0; i < E.size(); ++i) {
    const VecK p = point(i);
    const Mat3 e = E[i].transpose() * E[i];
    Eigen::Matrix<double, K*(K + 1) / 2, 1> q;
    for (int r = 0, at = 0; r < K; ++r)
      for (int c = r; c < K; ++c) q[at++] = p[r] * p[c];
    const Vec6 w(e(0, 0), e(0, 1), e(0, 2), e(1, 1), e(1, 2), e(2, 2));
    sums.noalias() += q * w.transpose();
  }
  Eigen::Matrix<double, N, N> G;
  for (int i = 0, block = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j, ++block) {
      for (int r = 0, at = 0; r < K; ++r)
        for (int c = r; c < K; ++c, ++at) {
          const double m = sums(at, block);
          G(K * i + r, K * j + c) = G(K * i + c, K * j + r) = m;
          G(K * j + r, K * i + c) = G(K * j + c, K * i + r) = m;
        }
    }
  }
  const auto gradient = [&](const Eigen::Matrix<double, N, 1>& h) {
    const Eigen::Matrix<double, K, 3> Ht = Eigen::Map<const Eigen::Matrix<double, K, 3>>(h.data());
    Eigen::Matrix<double, K, 3> sum = Eigen::Matrix<double, K, 3>::Zero();
    for (std::size_t i = 0; i < E.size(); ++i) {
      const VecK p = point(i);
      const Vec2 r = E[i] * (Ht.transpose() * p);
      sum.noalias() += p * (E[i].transpose() * r).transpose();
    }
    return Eigen::Matrix<double, N, 1>(Eigen::Map<const Eigen::Matrix<double, N, 1>>(sum.data()));
  };
  const auto null = null_of_normal<N>(G, gradient);
  if (!null) return solve_dlt_by_svd(a, E);
  return {Eigen::Map<const Eigen::Matrix<double, K, 3>>(null->v.data()).transpose(), null->determinacy};
}

}  // namespace

DltSolution solve_dlt(const MatX& a, std::span<const Mat23> E) {
  PLUMBLINE_CHECK(a.rows() == 3 || a.rows() == 4, "solve_dlt needs points of a plane or of space");
  return a.rows() == 3 ? solve_dlt_of<3>(a, E) : solve_dlt_of<4>(a, E);
}

}  // namespace plumbline::detail
