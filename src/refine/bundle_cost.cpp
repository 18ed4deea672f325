// SPDX-License-Identifier: Apache-2.0
// The bundle's counterpart of reprojection_cost.cpp: Ceres' types over the lenses, one sighting each.
#include "refine/bundle_cost.hpp"

#include <ceres/manifold.h>
#include <ceres/sized_cost_function.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "plumbline/geometry/so3.hpp"
#include "refine/pose_block.hpp"

namespace plumbline::detail {
namespace {

// J [-[v]_x | I | 0], two rows of seven columns; the row j (-[v]_x) is v x j.
void write_pose(double* out, const Mat23& J, const Vec3& v) {
  for (int row = 0; row < 2; ++row, out += 7) {
    const Vec3 j = J.row(row);
    const Vec3 w = v.cross(j);
    std::copy_n(w.data(), 3, out);
    std::copy_n(j.data(), 3, out + 3);
    out[6] = 0;
  }
}

template <class L>
class SightingCost final : public ceres::SizedCostFunction<2, L::kNumParams, 7, 3> {
 public:
  SightingCost(const Vec2& px, double weight) : px_(px), weight_(weight) {}

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    std::array<double, L::kNumParams> k;
    std::copy_n(blocks[0], k.size(), k.begin());
    const L lens = std::bit_cast<L>(k);
    const Eigen::Quaterniond q(blocks[1][0], blocks[1][1], blocks[1][2], blocks[1][3]);
    const Mat3 R = q.toRotationMatrix();
    const Vec3 turned = R * Vec3(blocks[2][0], blocks[2][1], blocks[2][2]);
    const Vec3 p_cam = turned + Vec3(blocks[1][4], blocks[1][5], blocks[1][6]);
    Mat23 J_px_p;
    JacParams<L> J_px_k;
    const bool wants_k = jacobians && jacobians[0];
    const auto px = lens.project(p_cam, jacobians ? &J_px_p : nullptr, wants_k ? &J_px_k : nullptr);
    if (!px) return false;
    residuals[0] = weight_ * (px->x() - px_.x());
    residuals[1] = weight_ * (px->y() - px_.y());
    if (!jacobians) return true;
    if (wants_k) {
      Eigen::Map<Eigen::Matrix<double, 2, L::kNumParams, Eigen::RowMajor>> J(jacobians[0]);
      J = weight_ * J_px_k;
    }
    const Mat23 J_r_p = weight_ * J_px_p;
    if (jacobians[1]) write_pose(jacobians[1], J_r_p, turned);
    if (jacobians[2]) {
      Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>> J(jacobians[2]);
      J.noalias() = J_r_p * R;
    }
    return true;
  }

 private:
  Vec2 px_;
  double weight_;
};

// A lens with thousands of parameters, which a bundle holds: a copy for each sighting would take gigabytes.
class HeldLensCost final : public ceres::CostFunction {
 public:
  HeldLensCost(const Lens& lens, const Vec2& px, double weight) : lens_(lens), px_(px), weight_(weight) {
    set_num_residuals(2);
    *mutable_parameter_block_sizes() = {n_params(lens_), 7, 3};
  }

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    const SE3 T = pose_of(blocks[1]);
    const Mat3 R = T.R();
    const Vec3 turned = R * Vec3(blocks[2][0], blocks[2][1], blocks[2][2]);
    Mat23 J_px_p;
    const auto px = project(lens_, turned + T.t(), jacobians ? &J_px_p : nullptr);
    if (!px || (jacobians && jacobians[0])) return false;
    residuals[0] = weight_ * (px->x() - px_.x());
    residuals[1] = weight_ * (px->y() - px_.y());
    if (!jacobians) return true;
    const Mat23 J_r_p = weight_ * J_px_p;
    if (jacobians[1]) write_pose(jacobians[1], J_r_p, turned);
    if (jacobians[2]) {
      Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>> J(jacobians[2]);
      J.noalias() = J_r_p * R;
    }
    return true;
  }

 private:
  const Lens& lens_;
  Vec2 px_;
  double weight_;
};

class ScaleBarCost final : public ceres::SizedCostFunction<1, 3, 3> {
 public:
  ScaleBarCost(double length, double sigma) : length_(length), sigma_(sigma) {}

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    const Vec3 d = Eigen::Map<const Vec3>(blocks[0]) - Eigen::Map<const Vec3>(blocks[1]);
    const double length = d.norm();
    if (!(length > 0)) return false;
    residuals[0] = (length - length_) / sigma_;
    if (!jacobians) return true;
    const Vec3 slope = d / (length * sigma_);
    if (jacobians[0]) Eigen::Map<Vec3>{jacobians[0]} = slope;
    if (jacobians[1]) Eigen::Map<Vec3>{jacobians[1]} = -slope;
    return true;
  }

 private:
  double length_, sigma_;
};

class SphereManifold final : public ceres::Manifold {
 public:
  explicit SphereManifold(const SphereStep& step) : step_(step) {}
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 5; }

  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    const SE3 T = step_.plus(pose_of(x), Eigen::Map<const Eigen::Matrix<double, 5, 1>>(delta));
    std::copy(T.qt.begin(), T.qt.end(), x_plus_delta);
    return true;
  }
  bool PlusJacobian(const double* x, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 7, 5, Eigen::RowMajor>> J(jacobian);
    J.setZero();
    J.topRows<6>() = step_.jacobian(pose_of(x));
    return true;
  }
  // Neither the minimiser nor anything else that is used here takes differences of states.
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }

 private:
  SphereStep step_;
};

class LinearManifold final : public ceres::Manifold {
 public:
  explicit LinearManifold(MatX M) : M_(std::move(M)) {}
  int AmbientSize() const override { return static_cast<int>(M_.rows()); }
  int TangentSize() const override { return static_cast<int>(M_.cols()); }

  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    Eigen::Map<VecX>{x_plus_delta, M_.rows()} =
        Eigen::Map<const VecX>(x, M_.rows()) + M_ * Eigen::Map<const VecX>(delta, M_.cols());
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    for (Eigen::Index r = 0; r < M_.rows(); ++r) {
      for (Eigen::Index c = 0; c < M_.cols(); ++c) *jacobian++ = M_(r, c);
    }
    return true;
  }
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }

 private:
  MatX M_;
};

}  // namespace

std::unique_ptr<ceres::CostFunction> make_sighting_cost(const Lens& lens, const Vec2& px, double sigma_px) {
  return std::visit(
      [&]<class L>(const L&) -> std::unique_ptr<ceres::CostFunction> {
        if constexpr (FixedLens<L>)
          return std::make_unique<SightingCost<L>>(px, 1 / sigma_px);
        else
          return std::make_unique<HeldLensCost>(lens, px, 1 / sigma_px);
      },
      lens);
}

std::unique_ptr<ceres::CostFunction> make_scale_bar_cost(double length, double sigma) {
  return std::make_unique<ScaleBarCost>(length, sigma);
}

Eigen::Matrix<double, 3, 2> SphereStep::tangents(const Vec3& u) const {
  // The axis farthest from u gives the best conditioned pair, and the same one for the same bytes.
  Eigen::Index axis = 0;
  u.cwiseAbs().minCoeff(&axis);
  Eigen::Matrix<double, 3, 2> B;
  B.col(0) = u.cross(Vec3::Unit(axis)).normalized();
  B.col(1) = u.cross(B.col(0));
  return B;
}

SE3 SphereStep::plus(const SE3& T, const Eigen::Matrix<double, 5, 1>& d) const {
  const Vec3 u = (T.centre() - anchor_).normalized();
  const Vec3 move = tangents(u) * d.tail<2>() / radius_;
  const Vec3 turned = so3_exp(u.cross(move)) * u;  // by |move| radians towards it
  const SE3 stepped = box_plus(T, (Vec6() << d.head<3>(), Vec3::Zero()).finished());
  const Vec3 t = -(stepped.R() * (anchor_ + radius_ * turned));
  SE3 result = stepped;
  std::copy_n(t.data(), 3, result.qt.begin() + 4);
  return result;
}

Eigen::Matrix<double, 6, 5> SphereStep::jacobian(const SE3& T) const {
  // t = -R C, so dt = dw x t - R dC.
  const Vec3 u = (T.centre() - anchor_).normalized();
  Eigen::Matrix<double, 6, 5> J = Eigen::Matrix<double, 6, 5>::Zero();
  J.topLeftCorner<3, 3>().setIdentity();
  J.bottomLeftCorner<3, 3>() = -skew(T.t());
  J.bottomRightCorner<3, 2>() = -T.R() * tangents(u);
  return J;
}

std::unique_ptr<ceres::Manifold> make_sphere_manifold(const SphereStep& step) {
  return std::make_unique<SphereManifold>(step);
}

std::unique_ptr<ceres::Manifold> make_linear_manifold(const MatX& M) {
  return std::make_unique<LinearManifold>(M);
}

}  // namespace plumbline::detail
