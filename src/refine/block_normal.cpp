// SPDX-License-Identifier: Apache-2.0
#include "refine/block_normal.hpp"

#include <algorithm>
#include <cmath>

#include "plumbline/core/parallel.hpp"
#include "plumbline/geometry/so3.hpp"
#include "refine/block_runs.hpp"

namespace plumbline::detail {
namespace {

// Where the parameters of a view's camera stand in BlockFrame::shared.
int place_of(const BlockFrame& frame, int parameter) {
  return static_cast<int>(std::lower_bound(frame.shared.begin(), frame.shared.end(), parameter) -
                          frame.shared.begin());
}

Mat6 turned(const Mat3& R) {
  Mat6 M = Mat6::Zero();
  M.topLeftCorner<3, 3>() = M.bottomRightCorner<3, 3>() = R;
  return M;
}

// What turns the kernel's [dw | dt], which moves the board in the camera's frame: a step of the board by the
// camera's rotation; a step of the camera also swings the board about the camera's centre.
Mat6 step_of_board(const SE3& T_cam_rig) { return turned(T_cam_rig.R()); }
Mat6 step_of_camera(const SE3& T_cam_rig, const SE3& T_rig_board) {
  Mat6 M = Mat6::Identity();
  M.bottomLeftCorner<3, 3>() = -skew(T_cam_rig.R() * T_rig_board.t());
  return M;
}

struct Sum {
  bool ok = true;
  double cost = 0;
  MatX A;
  VecX g;
};

// Adds one frame: its own blocks to `normal`, what is shared to `sum`.
void add_frame(const BlockProblem& problem, const BlockState& state, std::size_t f, FrameNormal& normal,
               Sum& sum) {
  const BlockFrame& frame = problem.frames[f];
  const SE3& T_rig_board = state.T_rig_board[f];
  normal.A_ff.setZero();
  normal.g_f.setZero();
  normal.A_sf.setZero(static_cast<Eigen::Index>(frame.shared.size()), 6);
  MatX gram;
  for (const BlockView& view : frame.views) {
    const SE3& T_cam_rig = state.T_cam_rig[view.cam];
    const Lens& lens = state.lenses[view.cam];
    const auto cost = accumulate_view(
        {lens, T_cam_rig * T_rig_board, view.corners, problem.loss, problem.loss_scale}, &gram);
    if (!cost || !std::isfinite(*cost)) {
      sum.ok = false;
      return;
    }
    sum.cost += *cost;
    const int n = n_params(lens), lens_at = problem.offsets.lens[view.cam],
              pose_at = problem.offsets.pose[view.cam];
    const Mat3 R = T_cam_rig.R();
    // The kernel's [dw | dt] moves the board in the camera's frame. A step of the board turns into it by R; a
    // step of the camera also swings the board about the camera's centre.
    const Mat6 M_board = turned(R);
    const Mat6 A_pp = gram.block<6, 6>(n, n);
    const Vec6 g_p = gram.block<6, 1>(n, n + 6);
    normal.A_ff.noalias() += M_board.transpose() * A_pp * M_board;
    normal.g_f.noalias() += M_board.transpose() * g_p;
    normal.A_sf.middleRows(place_of(frame, lens_at), n).noalias() += gram.block(0, n, n, 6) * M_board;
    sum.A.block(lens_at, lens_at, n, n) += gram.topLeftCorner(n, n);
    sum.g.segment(lens_at, n) += gram.block(0, n + 6, n, 1);
    if (pose_at < 0) continue;
    const Mat6 M_cam = step_of_camera(T_cam_rig, T_rig_board);
    const Mat6 A_cp = M_cam.transpose() * A_pp;
    normal.A_sf.middleRows(place_of(frame, pose_at), 6).noalias() += A_cp * M_board;
    sum.A.block<6, 6>(pose_at, pose_at).noalias() += A_cp * M_cam;
    const MatX lens_cam = gram.block(0, n, n, 6) * M_cam;
    sum.A.block(lens_at, pose_at, n, 6) += lens_cam;
    sum.A.block(pose_at, lens_at, 6, n) += lens_cam.transpose();
    sum.g.segment<6>(pose_at).noalias() += M_cam.transpose() * g_p;
  }
}

}  // namespace

BlockProblem block_problem(const Calibration& cal, const SolveSpec& spec) {
  BlockProblem problem{offsets_of(cal.rig), {}, spec.loss, spec.loss_scale, spec.n_threads};
  std::vector<int> place(cal.T_rig_board.size(), -1);
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    const std::vector<Observation> observations = observations_of(cal, v, spec.use_sigma);
    if (observations.empty()) continue;
    int& at = place[cal.data.views[v].frame];
    if (at < 0) {
      at = static_cast<int>(problem.frames.size());
      problem.frames.push_back({cal.data.views[v].frame, {}, {}});
    }
    problem.frames[at].views.push_back({cal.data.views[v].cam, view_corners(observations)});
  }
  for (BlockFrame& frame : problem.frames) {
    for (const BlockView& view : frame.views) {
      for (int i = 0; i < n_params(cal.rig.cameras[view.cam].lens); ++i)
        frame.shared.push_back(problem.offsets.lens[view.cam] + i);
      for (int i = 0; i < 6 && view.cam > 0; ++i) frame.shared.push_back(problem.offsets.pose[view.cam] + i);
    }
    std::sort(frame.shared.begin(), frame.shared.end());
    frame.shared.erase(std::unique(frame.shared.begin(), frame.shared.end()), frame.shared.end());
  }
  return problem;
}

std::optional<BlockNormal> block_normal(const BlockProblem& problem, const BlockState& state) {
  const Runs runs(problem.frames.size());
  const int n = problem.offsets.total;
  BlockNormal normal;
  normal.frames.resize(problem.frames.size());
  std::vector<Sum> sums(static_cast<std::size_t>(runs.n_runs));
  parallel_for(runs.n_runs, problem.n_threads, [&](int run) {
    Sum& sum = sums[static_cast<std::size_t>(run)];
    sum.A = MatX::Zero(n, n);
    sum.g = VecX::Zero(n);
    for (int f = runs.first(run); f < runs.first(run + 1) && sum.ok; ++f)
      add_frame(problem, state, static_cast<std::size_t>(f), normal.frames[static_cast<std::size_t>(f)], sum);
  });
  normal.A_ss = MatX::Zero(n, n);
  normal.g_s = VecX::Zero(n);
  for (const Sum& sum : sums) {
    if (!sum.ok) return std::nullopt;
    normal.cost += sum.cost;
    normal.A_ss += sum.A;
    normal.g_s += sum.g;
  }
  return normal;
}

BlockVector gradient(const BlockNormal& normal) {
  BlockVector g{normal.g_s, {}};
  g.boards.reserve(normal.frames.size());
  for (const FrameNormal& frame : normal.frames) g.boards.push_back(frame.g_f);
  return g;
}

BlockVector times(const BlockProblem& problem, const BlockNormal& normal, const BlockVector& v) {
  BlockVector out{normal.A_ss * v.shared, {}};
  for (std::size_t f = 0; f < problem.frames.size(); ++f) {
    const FrameNormal& frame = normal.frames[f];
    const std::vector<int>& shared = problem.frames[f].shared;
    out.shared(shared) += frame.A_sf * v.boards[f];
    out.boards.push_back(frame.A_ff * v.boards[f] + frame.A_sf.transpose() * v.shared(shared));
  }
  return out;
}

std::optional<BlockVector> mixed_gradient(const BlockProblem& problem, const BlockState& state,
                                          const BlockState& other) {
  const std::size_t n_frames = problem.frames.size();
  const Runs runs(n_frames);
  BlockVector out{VecX::Zero(problem.offsets.total), std::vector<Vec6>(n_frames, Vec6::Zero())};
  std::vector<Sum> sums(static_cast<std::size_t>(runs.n_runs));
  parallel_for(runs.n_runs, problem.n_threads, [&](int run) {
    Sum& sum = sums[static_cast<std::size_t>(run)];
    sum.g = VecX::Zero(problem.offsets.total);
    for (int i = runs.first(run); i < runs.first(run + 1) && sum.ok; ++i) {
      const auto f = static_cast<std::size_t>(i);
      for (const BlockView& view : problem.frames[f].views) {
        const SE3& T_cam_rig = state.T_cam_rig[view.cam];
        const Lens& lens = state.lenses[view.cam];
        const auto second = accumulate_second(
            {lens, T_cam_rig * state.T_rig_board[f], view.corners, problem.loss, problem.loss_scale},
            other.lenses[view.cam], other.T_cam_rig[view.cam] * other.T_rig_board[f]);
        if (!second) {
          sum.ok = false;
          break;
        }
        const int n = n_params(lens), pose_at = problem.offsets.pose[view.cam];
        const Vec6 g_p = second->tail<6>();
        sum.g.segment(problem.offsets.lens[view.cam], n) += second->head(n);
        out.boards[f] += step_of_board(T_cam_rig).transpose() * g_p;
        if (pose_at >= 0)
          sum.g.segment<6>(pose_at) += step_of_camera(T_cam_rig, state.T_rig_board[f]).transpose() * g_p;
      }
    }
  });
  for (const Sum& sum : sums) {
    if (!sum.ok) return std::nullopt;
    out.shared += sum.g;
  }
  return out;
}

}  // namespace plumbline::detail
