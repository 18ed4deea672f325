// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rig/motion.hpp"

#include <algorithm>
#include <cmath>

#include "plumbline/geometry/so3.hpp"

namespace plumbline {
namespace {

// Lagrange's polynomials through the times of a stencil, and their derivatives.
struct Weights {
  std::array<double, kMotionFrames> value{}, slope{};
};

Weights weights_at(const std::array<double, kMotionFrames>& t, double at) {
  Weights w;
  for (int j = 0; j < kMotionFrames; ++j) {
    double value = 1, slope = 0;
    for (int k = 0; k < kMotionFrames; ++k) {
      if (k == j) continue;
      const double span = t[j] - t[k];
      slope = (slope * (at - t[k]) + value) / span;
      value *= (at - t[k]) / span;
    }
    w.value[j] = value;
    w.slope[j] = slope;
  }
  return w;
}

}  // namespace

bool has_clocks(const Calibration& calibration) {
  return std::any_of(calibration.clocks.begin(), calibration.clocks.end(),
                     [](const CameraClock& c) { return c.line_delay_s || c.time_offset_s; });
}

Trajectory trajectory_of(const Calibration& calibration) {
  const std::size_t n_frames = calibration.T_rig_board.size();
  Trajectory trajectory{std::vector<std::optional<double>>(n_frames),
                        std::vector<std::optional<MotionStencil>>(n_frames)};
  for (const View& view : calibration.data.views) {
    auto& time_s = trajectory.time_s[view.frame];
    if (!time_s && !view.corners.empty()) time_s = view.time_s;
  }
  std::vector<int> order;
  for (std::size_t f = 0; f < n_frames; ++f) {
    if (trajectory.time_s[f] && calibration.T_rig_board[f]) order.push_back(static_cast<int>(f));
  }
  const auto time_of = [&](int i) { return *trajectory.time_s[order[i]]; };
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return *trajectory.time_s[a] < *trajectory.time_s[b]; });
  const int n = static_cast<int>(order.size());
  for (int first = 0, end = 0; first < n; first = end) {
    for (end = first + 1; end < n; ++end) {
      const double gap = time_of(end) - time_of(end - 1);
      if (gap > kLongestGap_s || !(gap > 0)) break;
    }
    if (end - first < kMotionFrames) continue;
    for (int i = first; i < end; ++i) {
      const int from = std::clamp(i - kMotionFrames / 2, first, end - kMotionFrames);
      MotionStencil stencil;
      stencil.centre = i - from;
      for (int j = 0; j < kMotionFrames; ++j) {
        stencil.frames[j] = order[from + j];
        stencil.t_s[j] = time_of(from + j) - time_of(i);
      }
      trajectory.stencils[order[i]] = stencil;
    }
  }
  return trajectory;
}

BoardMotion::BoardMotion(const MotionStencil& stencil, const std::array<SE3, kMotionFrames>& T_rig_board)
    : stencil_(stencil), R_centre_(T_rig_board[stencil.centre].R()) {
  for (int j = 0; j < kMotionFrames; ++j) {
    w_[j] = j == stencil.centre ? Vec3(0, 0, 0) : so3_log(T_rig_board[j].R() * R_centre_.transpose());
    t_[j] = T_rig_board[j].t();
  }
}

bool BoardMotion::covers(double dt_s) const {
  return dt_s >= stencil_.t_s.front() - kLongestGap_s && dt_s <= stencil_.t_s.back() + kLongestGap_s;
}

MovingPose BoardMotion::at(double dt_s, Jacobian* J) const {
  const Weights weights = weights_at(stencil_.t_s, dt_s);
  Vec3 w = Vec3::Zero(), slope = Vec3::Zero();
  MovingPose pose;
  for (int j = 0; j < kMotionFrames; ++j) {
    w += weights.value[j] * w_[j];
    slope += weights.slope[j] * w_[j];
    pose.t += weights.value[j] * t_[j];
    pose.v += weights.slope[j] * t_[j];
  }
  const Mat3 turn = so3_exp(w), J_l = so3_left_jacobian(w);
  pose.R = turn * R_centre_;
  pose.w = J_l * slope;
  if (!J) return pose;
  J->translation = weights.value;
  // A step of R_j turns log(R_j R_c') by J_l^-1, one of R_c by -J_r^-1, and R_c itself is turned along.
  Mat3& at_centre = J->rotation[stencil_.centre];
  at_centre = turn;
  for (int j = 0; j < kMotionFrames; ++j) {
    if (j == stencil_.centre) continue;
    const Mat3 share = weights.value[j] * J_l;
    J->rotation[j] = share * so3_left_jacobian_inverse(w_[j]);
    at_centre -= share * so3_right_jacobian_inverse(w_[j]);
  }
  return pose;
}

std::optional<Exposure> exposure_of(const Calibration& calibration, const Trajectory& trajectory,
                                    const View& view) {
  const auto& frame_s = trajectory.time_s[view.frame];
  if (!frame_s || !view.time_s) return std::nullopt;
  const auto cam = static_cast<std::size_t>(view.cam);
  const CameraClock clock = cam < calibration.clocks.size() ? calibration.clocks[cam] : CameraClock{};
  return Exposure{*view.time_s - *frame_s + clock.time_offset_s.value_or(0.0),
                  clock.line_delay_s.value_or(0.0), 0.5 * (calibration.rig.cameras[cam].size.height - 1)};
}

std::optional<RowPixel> project_moving(const Lens& lens, const SE3& T_cam_rig, const BoardMotion& motion,
                                       const Exposure& exposure, const Vec3& p_board0) {
  constexpr int kMostSteps = 20;
  constexpr double kExact_px = 1e-9;  // the next step is the square of it
  const Mat3 R_cam_rig = T_cam_rig.R();
  RowPixel out;
  out.row = exposure.middle_row;
  for (int i = 0; i < kMostSteps; ++i) {
    out.dt_s = exposure.start_s + exposure.line_delay_s * (out.row - exposure.middle_row);
    if (!motion.covers(out.dt_s)) return std::nullopt;
    out.pose = motion.at(out.dt_s);
    const Vec3 turned = out.pose.R * p_board0;
    Mat23 J_px_p;
    const auto px = project(lens, R_cam_rig * (turned + out.pose.t) + T_cam_rig.t(), &J_px_p);
    if (!px) return std::nullopt;
    out.px = *px;
    if (exposure.line_delay_s == 0) {
      out.row = px->y();  // what a delay would act on
      return out;
    }
    const Vec2 px_per_row =
        exposure.line_delay_s * (J_px_p * (R_cam_rig * (out.pose.w.cross(turned) + out.pose.v)));
    // A point that outruns the shutter is seen in many rows, or in none.
    if (!(std::abs(px_per_row.y()) < 0.9)) return std::nullopt;
    const double step = (px->y() - out.row) / (1 - px_per_row.y());
    out.row += step;
    if (std::abs(step) > kExact_px) continue;
    out.px += step * px_per_row;
    return out;
  }
  return std::nullopt;
}

std::optional<Vec2> predict(const Calibration& calibration, const Trajectory& trajectory, const View& view,
                            int point) {
  const auto& stencil = trajectory.stencils[view.frame];
  const auto exposure = exposure_of(calibration, trajectory, view);
  if (!stencil || !exposure) return std::nullopt;
  std::array<SE3, kMotionFrames> poses;
  for (int j = 0; j < kMotionFrames; ++j) poses[j] = *calibration.T_rig_board[stencil->frames[j]];
  Vec3 p_board0 = board_point(calibration, view.target, point);
  if (view.target > 0) p_board0 = calibration.T_board0_board[view.target] * p_board0;
  const auto seen =
      project_moving(calibration.rig.cameras[view.cam].lens, calibration.rig.T_cam_rig[view.cam],
                     BoardMotion(*stencil, poses), *exposure, p_board0);
  if (!seen) return std::nullopt;
  return seen->px;
}

}  // namespace plumbline
