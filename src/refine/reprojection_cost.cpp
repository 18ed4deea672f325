// SPDX-License-Identifier: Apache-2.0
// The only file that instantiates Ceres' types over the lenses: each costs about half a second to compile.
#include "refine/reprojection_cost.hpp"

#include <ceres/cost_function.h>
#include <ceres/manifold.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "plumbline/core/check.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/geometry/so3.hpp"
#include "refine/pose_block.hpp"

namespace plumbline::detail {

Rho rho(Loss loss, double scale, double s) {
  const double bend = scale * scale;
  switch (loss) {
    case Loss::kHuber:
      if (s > bend) return {2 * scale * std::sqrt(s) - bend, scale / std::sqrt(s)};
      break;
    case Loss::kCauchy:
      return {bend * std::log1p(s / bend), 1 / (1 + s / bend)};
    case Loss::kSquared:
      break;
  }
  return {s, 1};
}

Scaling scaling_of(Loss loss, double scale, double s) {
  if (loss == Loss::kSquared) return {};
  // Near s = 0 the quotient is 0/0. Cauchy: rho / s = 1 - s / (2 c^2) + ..., so f = 1 - s / (4 c^2).
  if (s < 1e-10 * scale * scale) {
    const double slope = loss == Loss::kCauchy ? -0.25 / (scale * scale) : 0.0;
    return {1 + slope * s, slope};
  }
  const Rho r = rho(loss, scale, s);
  if (r.value == s) return {};
  const double f = std::sqrt(r.value / s);
  return {f, (r.derivative * s - r.value) / (2 * f * s * s)};
}

namespace {

template <class L>
class ViewCost final : public ceres::CostFunction {
 public:
  ViewCost(std::vector<Observation> observations, Loss loss, double loss_scale, bool further_board,
           bool bowed)
      : observations_(std::move(observations)),
        loss_(loss),
        loss_scale_(loss_scale),
        further_board_(further_board),
        bow_block_(bowed ? (further_board ? 4 : 3) : -1) {
    set_num_residuals(static_cast<int>(2 * observations_.size()));
    *mutable_parameter_block_sizes() = {L::kNumParams, 7, 7};
    if (further_board) mutable_parameter_block_sizes()->push_back(7);
    if (bowed) mutable_parameter_block_sizes()->push_back(2);
  }

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    std::array<double, L::kNumParams> k;
    std::copy_n(blocks[0], k.size(), k.begin());
    const L lens = std::bit_cast<L>(k);
    const SE3 T_cam_rig = pose_of(blocks[1]), T_rig_board = pose_of(blocks[2]);
    const Mat3 R_cam_rig = T_cam_rig.R(), R_rig_board = T_rig_board.R();
    const Vec3 t_cam_rig = T_cam_rig.t(), t_rig_board = T_rig_board.t();
    const SE3 T_board0_board = further_board_ ? pose_of(blocks[3]) : SE3();
    const Mat3 R_board0_board = T_board0_board.R(), R_cam_board0 = R_cam_rig * R_rig_board;
    const Vec3 t_board0_board = T_board0_board.t();
    const Vec2 bow = bow_block_ < 0 ? Vec2(0, 0) : Vec2(blocks[bow_block_][0], blocks[bow_block_][1]);
    const Vec3 up_cam = R_cam_board0 * R_board0_board.col(2);
    Mat23 J_px_p;
    JacParams<L> J_px_k;
    const bool wants_k = jacobians && jacobians[0], wants_cam = jacobians && jacobians[1],
               wants_board = jacobians && jacobians[2],
               wants_further = further_board_ && jacobians && jacobians[3],
               wants_bow = bow_block_ >= 0 && jacobians && jacobians[bow_block_],
               wants_p = wants_cam || wants_board || wants_further || wants_bow;
    for (std::size_t i = 0; i < observations_.size(); ++i) {
      const Observation& o = observations_[i];
      Vec3 p_board0 = o.p_board, turned_further = o.p_board;
      if (bow_block_ >= 0) p_board0.z() += bow.dot(o.bow_shape);
      if (further_board_) {
        turned_further = R_board0_board * p_board0;
        p_board0 = turned_further + t_board0_board;
      }
      const Vec3 turned_board = R_rig_board * p_board0;
      const Vec3 turned_rig = R_cam_rig * (turned_board + t_rig_board);
      const auto px =
          lens.project(turned_rig + t_cam_rig, wants_p ? &J_px_p : nullptr, wants_k ? &J_px_k : nullptr);
      if (!px) return false;
      const Vec2 r = o.weight * (*px - o.px);
      const Scaling scaling = scaling_of(loss_, loss_scale_, r.squaredNorm());
      residuals[2 * i] = scaling.f * r.x();
      residuals[2 * i + 1] = scaling.f * r.y();
      if (!jacobians) continue;
      // d(r')/d(px)
      const Mat2 J_r_px = o.weight * (scaling.f * Mat2::Identity() + 2 * scaling.f_s * r * r.transpose());
      if (wants_k) {
        Eigen::Map<Eigen::Matrix<double, 2, L::kNumParams, Eigen::RowMajor>> J(jacobians[0] +
                                                                               2 * i * L::kNumParams);
        J.noalias() = J_r_px * J_px_k;
      }
      if (!wants_p) continue;
      const Mat23 J_r_p = J_r_px * J_px_p;
      if (wants_cam) write_pose(jacobians[1] + 14 * i, J_r_p, turned_rig);
      if (wants_board) write_pose(jacobians[2] + 14 * i, J_r_p * R_cam_rig, turned_board);
      if (wants_further) write_pose(jacobians[3] + 14 * i, J_r_p * R_cam_board0, turned_further);
      if (!wants_bow) continue;
      const Vec2 J_r_lift = J_r_p * up_cam;
      for (int row = 0; row < 2; ++row) {
        for (int b = 0; b < 2; ++b)
          jacobians[bow_block_][4 * i + 2 * row + b] = J_r_lift[row] * o.bow_shape[b];
      }
    }
    return true;
  }

 private:
  // J d(p)/d[dw | dt] = J [-[R p]_x | I], two rows of seven columns; the row j (-[v]_x) is v x j.
  static void write_pose(double* out, const Mat23& J, const Vec3& v) {
    for (int row = 0; row < 2; ++row, out += 7) {
      const double a = J(row, 0), b = J(row, 1), c = J(row, 2);
      out[0] = v.y() * c - v.z() * b;
      out[1] = v.z() * a - v.x() * c;
      out[2] = v.x() * b - v.y() * a;
      out[3] = a;
      out[4] = b;
      out[5] = c;
      out[6] = 0;
    }
  }

  std::vector<Observation> observations_;
  Loss loss_;
  double loss_scale_;
  bool further_board_;
  int bow_block_;  // -1: flat
};

class PoseManifold final : public ceres::Manifold {
 public:
  explicit PoseManifold(const std::array<bool, 6>& held) {
    for (int i = 0; i < 6; ++i) {
      if (!held[i]) free_.push_back(i);
    }
    const int n_held = held[0] + held[1] + held[2];
    by_rotation_vector_ = n_held == 1 || n_held == 2;
  }

  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return static_cast<int>(free_.size()); }

  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    Vec6 d = Vec6::Zero();
    for (std::size_t i = 0; i < free_.size(); ++i) d[free_[i]] = delta[i];
    const SE3 T = pose_of(x);
    SE3 stepped = T;
    if (by_rotation_vector_) {
      const Vec3 w = so3_log(T.R()) + d.head<3>();
      stepped = SE3(so3_exp(w), T.t() + d.tail<3>());
    } else {
      stepped = box_plus(T, d);
    }
    std::copy(stepped.qt.begin(), stepped.qt.end(), x_plus_delta);
    return true;
  }

  bool PlusJacobian(const double* x, double* jacobian) const override {
    const int n = TangentSize();
    std::fill_n(jacobian, 7 * n, 0.0);
    Mat6 step = Mat6::Identity();
    if (by_rotation_vector_) step.topLeftCorner<3, 3>() = so3_left_jacobian(so3_log(pose_of(x).R()));
    for (int row = 0; row < 6; ++row) {
      for (int i = 0; i < n; ++i) jacobian[row * n + i] = step(row, free_[i]);
    }
    return true;
  }

  bool Minus(const double* y, const double* x, double* y_minus_x) const override {
    const SE3 b = pose_of(y), a = pose_of(x);
    Vec6 d = box_minus(b, a);
    if (by_rotation_vector_) d.head<3>() = so3_log(b.R()) - so3_log(a.R());
    for (std::size_t i = 0; i < free_.size(); ++i) y_minus_x[i] = d[free_[i]];
    return true;
  }

  // The left inverse of PlusJacobian on the free components: [I6 | 0], or J_l^-1 in the rotation's corner.
  bool MinusJacobian(const double* x, double* jacobian) const override {
    Mat6 step = Mat6::Identity();
    if (by_rotation_vector_) step.topLeftCorner<3, 3>() = so3_left_jacobian_inverse(so3_log(pose_of(x).R()));
    for (std::size_t i = 0; i < free_.size(); ++i) {
      for (int column = 0; column < 7; ++column)
        jacobian[7 * i + column] = column < 6 ? step(free_[i], column) : 0.0;
    }
    return true;
  }

 private:
  std::vector<int> free_;
  bool by_rotation_vector_ = false;
};

}  // namespace

std::unique_ptr<ceres::CostFunction> make_view_cost(const Lens& lens, std::vector<Observation> observations,
                                                    Loss loss, double loss_scale, bool further_board,
                                                    bool bowed) {
  return std::visit(
      [&]<class L>(const L&) -> std::unique_ptr<ceres::CostFunction> {
        if constexpr (FixedLens<L>)
          return std::make_unique<ViewCost<L>>(std::move(observations), loss, loss_scale, further_board,
                                               bowed);
        else
          PLUMBLINE_CHECK(false, "a lens with sparse derivatives has make_sparse_cost()");
      },
      lens);
}

std::unique_ptr<ceres::Manifold> make_pose_manifold(const std::array<bool, 6>& held) {
  return std::make_unique<PoseManifold>(held);
}

}  // namespace plumbline::detail
