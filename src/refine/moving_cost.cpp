// SPDX-License-Identifier: Apache-2.0
#include "refine/moving_cost.hpp"

#include <ceres/cost_function.h>

#include <algorithm>
#include <utility>

#include "plumbline/geometry/so3.hpp"
#include "refine/pose_block.hpp"

namespace plumbline::detail {
namespace {

constexpr int kFirstPose = 2, kDelay = kFirstPose + kMotionFrames, kOffset = kDelay + 1,
              kFurther = kOffset + 1;

// Two rows of a row-major Jacobian with `stride` columns; entries beyond J's columns are zero.
template <class Derived>
void write(double* block, int i, int stride, const Eigen::MatrixBase<Derived>& J) {
  if (!block) return;
  for (int row = 0; row < 2; ++row) {
    double* out = block + static_cast<std::ptrdiff_t>(2 * i + row) * stride;
    for (int c = 0; c < stride; ++c) out[c] = c < J.cols() ? J(row, c) : 0;
  }
}

// J d(R p)/d[dw | dt], with v = R p.
Eigen::Matrix<double, 2, 6> by_step(const Mat23& J, const Vec3& v) {
  Eigen::Matrix<double, 2, 6> out;
  out.leftCols<3>() = -J * skew(v);
  out.rightCols<3>() = J;
  return out;
}

class MovingCost final : public ceres::CostFunction {
 public:
  explicit MovingCost(MovingView view) : view_(std::move(view)) {
    set_num_residuals(static_cast<int>(2 * view_.observations.size()));
    auto& sizes = *mutable_parameter_block_sizes();
    sizes = {n_params(view_.lens), 7};
    sizes.insert(sizes.end(), kMotionFrames, 7);
    sizes.insert(sizes.end(), 2, 1);
    if (view_.further_board) sizes.push_back(7);
    if (view_.bowed) sizes.push_back(2);
  }

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    const State s = state_of(blocks);
    for (int i = 0; i < static_cast<int>(view_.observations.size()); ++i) {
      if (!evaluate(s, i, residuals + static_cast<std::ptrdiff_t>(2 * i), jacobians)) return false;
    }
    return true;
  }

 private:
  struct State {
    Lens lens;
    SE3 T_cam_rig, T_board0_board;
    Mat3 R_cam_rig, R_board0_board;
    BoardMotion motion;
    Exposure exposure;
    Vec2 bow = Vec2::Zero();
  };

  int bow_block() const { return view_.further_board ? kFurther + 1 : kFurther; }

  State state_of(double const* const* blocks) const {
    std::array<SE3, kMotionFrames> poses;
    for (int j = 0; j < kMotionFrames; ++j) poses[j] = pose_of(blocks[kFirstPose + j]);
    State s{view_.lens,
            pose_of(blocks[1]),
            view_.further_board ? pose_of(blocks[kFurther]) : SE3(),
            {},
            {},
            BoardMotion(view_.stencil, poses),
            {view_.start_s + blocks[kOffset][0], blocks[kDelay][0], view_.middle_row}};
    s.R_cam_rig = s.T_cam_rig.R();
    s.R_board0_board = s.T_board0_board.R();
    std::copy_n(blocks[0], n_params(s.lens), params(s.lens).begin());
    if (view_.bowed) s.bow = Vec2(blocks[bow_block()][0], blocks[bow_block()][1]);
    return s;
  }

  bool evaluate(const State& s, int i, double* residuals, double** jacobians) const {
    const Observation& o = view_.observations[static_cast<std::size_t>(i)];
    const Vec3 turned_further = s.R_board0_board * (o.p_board + Vec3(0, 0, s.bow.dot(o.bow_shape)));
    const Vec3 p_board0 = turned_further + s.T_board0_board.t();
    const auto seen = project_moving(s.lens, s.T_cam_rig, s.motion, s.exposure, p_board0);
    if (!seen) return false;
    const Vec2 r = o.weight * (seen->px - o.px);
    const Scaling scaling = scaling_of(view_.loss, view_.loss_scale, r.squaredNorm());
    residuals[0] = scaling.f * r.x();
    residuals[1] = scaling.f * r.y();
    if (!jacobians) return true;
    BoardMotion::Jacobian J_motion;
    const MovingPose pose = s.motion.at(seen->dt_s, &J_motion);
    const Vec3 turned = pose.R * p_board0, turned_rig = s.R_cam_rig * (turned + pose.t);
    Mat23 J_px_p;
    JacLens J_px_k;
    if (!project(s.lens, turned_rig + s.T_cam_rig.t(), &J_px_p, &J_px_k)) return false;
    const Vec3 v_rig = pose.w.cross(turned) + pose.v;  // of the point [m/s]
    const Vec2 a = s.exposure.line_delay_s * (J_px_p * (s.R_cam_rig * v_rig));
    Mat2 rows = Mat2::Identity();
    rows.col(1) += a / (1 - a.y());
    const Mat2 J_r_px =
        o.weight * (scaling.f * Mat2::Identity() + 2 * scaling.f_s * r * r.transpose()) * rows;
    const Mat23 J_r_p = J_r_px * J_px_p, J_r_rig = J_r_p * s.R_cam_rig, J_r_board0 = J_r_rig * pose.R;
    write(jacobians[0], i, static_cast<int>(J_px_k.cols()), J_r_px * J_px_k);
    write(jacobians[1], i, 7, by_step(J_r_p, turned_rig));
    const Mat23 J_turn = -J_r_rig * skew(turned);
    for (int j = 0; j < kMotionFrames; ++j) {
      Eigen::Matrix<double, 2, 6> J;
      J.leftCols<3>() = J_turn * J_motion.rotation[j];
      J.rightCols<3>() = J_motion.translation[j] * J_r_rig;
      write(jacobians[kFirstPose + j], i, 7, J);
    }
    const Vec2 J_r_s = J_r_rig * v_rig;
    write(jacobians[kDelay], i, 1, (seen->row - s.exposure.middle_row) * J_r_s);
    write(jacobians[kOffset], i, 1, J_r_s);
    if (view_.further_board) write(jacobians[kFurther], i, 7, by_step(J_r_board0, turned_further));
    if (view_.bowed)
      write(jacobians[bow_block()], i, 2, J_r_board0 * s.R_board0_board.col(2) * o.bow_shape.transpose());
    return true;
  }

  MovingView view_;
};

}  // namespace

std::unique_ptr<ceres::CostFunction> make_moving_cost(MovingView view) {
  return std::make_unique<MovingCost>(std::move(view));
}

}  // namespace plumbline::detail
