// SPDX-License-Identifier: Apache-2.0
#include "refine/sparse_cost.hpp"

#include <ceres/cost_function.h>

#include <algorithm>
#include <cmath>

#include "plumbline/geometry/se3.hpp"
#include "refine/pose_block.hpp"

namespace plumbline::detail {
namespace {

// J d(p)/d[dw | dt] = J [-[v]_x | I] of one row: the row j (-[v]_x) is v x j.
void write_pose(double* out, const Vec3& j, const Vec3& v) {
  const Vec3 w = v.cross(j);
  std::copy_n(w.data(), 3, out);
  std::copy_n(j.data(), 3, out + 3);
  out[6] = 0;
}

constexpr std::size_t kCore = 4;

class SparseCost final : public ceres::CostFunction {
 public:
  SparseCost(std::shared_ptr<Lens> scratch, std::vector<Observation> observations, Loss loss,
             double loss_scale, bool further_board, bool bowed)
      : lens_(std::move(scratch)),
        observations_(std::move(observations)),
        loss_(loss),
        loss_scale_(loss_scale),
        further_board_(further_board),
        bow_block_(bowed ? (further_board ? 5 : 4) : -1) {
    set_num_residuals(static_cast<int>(2 * observations_.size()));
    *mutable_parameter_block_sizes() = {int(kCore), n_params(*lens_) - int(kCore), 7, 7};
    if (further_board) mutable_parameter_block_sizes()->push_back(7);
    if (bowed) mutable_parameter_block_sizes()->push_back(2);
  }

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    const std::span<double> k = params(*lens_);
    const std::size_t n_others = k.size() - kCore;
    std::copy_n(blocks[0], kCore, k.begin());
    std::copy_n(blocks[1], n_others, k.begin() + kCore);
    const SE3 T_cam_rig = pose_of(blocks[2]), T_rig_board = pose_of(blocks[3]);
    const SE3 T_board0_board = further_board_ ? pose_of(blocks[4]) : SE3();
    const Mat3 R_cam_rig = T_cam_rig.R(), R_rig_board = T_rig_board.R(), R_further = T_board0_board.R();
    const Vec2 bow = bow_block_ < 0 ? Vec2(0, 0) : Vec2(blocks[bow_block_][0], blocks[bow_block_][1]);
    const auto n_rows = static_cast<std::size_t>(num_residuals());
    if (jacobians && jacobians[0]) std::fill_n(jacobians[0], n_rows * kCore, 0.0);
    if (jacobians && jacobians[1]) std::fill_n(jacobians[1], n_rows * n_others, 0.0);
    for (std::size_t i = 0; i < observations_.size(); ++i) {
      const Observation& o = observations_[i];
      const Vec3 turned_further = R_further * (o.p_board + Vec3(0, 0, bow.dot(o.bow_shape)));
      const Vec3 turned_board = R_rig_board * (turned_further + T_board0_board.t());
      const Vec3 turned_rig = R_cam_rig * (turned_board + T_rig_board.t());
      Mat23 J_px_p;
      SparseJac J_px_k;
      const auto px = project_sparse(*lens_, turned_rig + T_cam_rig.t(), jacobians ? &J_px_p : nullptr,
                                     jacobians ? &J_px_k : nullptr);
      if (!px) return false;
      const Vec2 r = o.weight * (*px - o.px);
      const Scaling scaling = scaling_of(loss_, loss_scale_, r.squaredNorm());
      residuals[2 * i] = scaling.f * r.x();
      residuals[2 * i + 1] = scaling.f * r.y();
      if (!jacobians) continue;
      const Mat2 J_r_px = o.weight * (scaling.f * Mat2::Identity() + 2 * scaling.f_s * r * r.transpose());
      const Mat23 J_r_p = J_r_px * J_px_p, J_r_rig = J_r_p * R_cam_rig, J_r_board0 = J_r_rig * R_rig_board;
      for (std::size_t axis = 0; axis < 2; ++axis) {
        const std::size_t row = 2 * i + axis;
        const auto a = static_cast<Eigen::Index>(axis);
        for (int e = 0; e < J_px_k.n; ++e) {
          const auto at = static_cast<std::size_t>(J_px_k.index[e]);
          const bool core = at < kCore;
          if (double* J = jacobians[core ? 0 : 1])
            J[core ? row * kCore + at : row * n_others + at - kCore] = J_r_px.row(a) * J_px_k.J[e];
        }
        if (jacobians[2]) write_pose(jacobians[2] + 7 * row, J_r_p.row(a), turned_rig);
        if (jacobians[3]) write_pose(jacobians[3] + 7 * row, J_r_rig.row(a), turned_board);
        if (further_board_ && jacobians[4])
          write_pose(jacobians[4] + 7 * row, J_r_board0.row(a), turned_further);
        if (bow_block_ < 0 || !jacobians[bow_block_]) continue;
        const double lift = J_r_board0.row(a) * R_further.col(2);
        for (int b = 0; b < 2; ++b) jacobians[bow_block_][2 * row + b] = lift * o.bow_shape[b];
      }
    }
    return true;
  }

 private:
  std::shared_ptr<Lens> lens_;
  std::vector<Observation> observations_;
  Loss loss_;
  double loss_scale_;
  bool further_board_;
  int bow_block_;  // -1: flat
};

class PriorCost final : public ceres::CostFunction {
 public:
  PriorCost(const PriorRow& row, int n, double scale) : row_(row) {
    for (double& w : row_.weight) w *= scale;
    for (int& i : row_.index) i -= static_cast<int>(kCore);
    set_num_residuals(1);
    *mutable_parameter_block_sizes() = {n - static_cast<int>(kCore)};
  }

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    residuals[0] = 0;
    for (std::size_t i = 0; i < 2; ++i) residuals[0] += row_.weight[i] * blocks[0][row_.index[i]];
    if (!jacobians || !jacobians[0]) return true;
    std::fill_n(jacobians[0], parameter_block_sizes()[0], 0.0);
    for (std::size_t i = 0; i < 2; ++i) jacobians[0][row_.index[i]] = row_.weight[i];
    return true;
  }

 private:
  PriorRow row_;
};

}  // namespace

std::unique_ptr<ceres::CostFunction> make_sparse_cost(std::shared_ptr<Lens> scratch,
                                                      std::vector<Observation> observations, Loss loss,
                                                      double loss_scale, bool further_board, bool bowed) {
  return std::make_unique<SparseCost>(std::move(scratch), std::move(observations), loss, loss_scale,
                                      further_board, bowed);
}

std::unique_ptr<ceres::CostFunction> make_prior_cost(const PriorRow& row, int n_params, double scale) {
  return std::make_unique<PriorCost>(row, n_params, scale);
}

double prior_scale(int n_residuals, int n_params) {
  return std::sqrt(n_residuals / (16.0 * std::max(1, n_params - 4)));
}

}  // namespace plumbline::detail
