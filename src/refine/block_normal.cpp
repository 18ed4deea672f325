// SPDX-License-Identifier: Apache-2.0
#include "refine/block_normal.hpp"

#include <algorithm>
#include <cmath>

#include "plumbline/geometry/so3.hpp"
#include "refine/block_runs.hpp"

namespace plumbline::detail {
namespace {

using Couplings = Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 6>>;
using LensRows = Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::ColMajor, kMaxLensParams, 6>;

// Row of a shared parameter in the couplings of a frame.
int row_of(const BlockFrame& frame, int parameter) {
  int row = 0;
  for (const Segment& s : frame.shared) {
    if (parameter >= s.first && parameter < s.first + s.n) return row + parameter - s.first;
    row += s.n;
  }
  return -1;
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

// The parts of a view's gram: pose with pose, lens with pose, pose with residual.
struct Parts {
  Mat6 A_pp;
  LensRows A_lp;
  Vec6 g_p;
  Parts(const Gram& gram, int n) : A_lp(n, 6) {
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < n; ++j) A_lp(j, i) = gram(n + i, j);
      for (int j = 0; j <= i; ++j) A_pp(i, j) = A_pp(j, i) = gram(n + i, n + j);
      g_p[i] = gram(n + 6, n + i);
    }
  }
};

// Adds one view: its frame's own blocks to `normal`, what is shared to `sums`.
bool add_view(const BlockProblem& problem, const BlockState& state, std::size_t f, const BlockView& view,
              BlockNormal& normal, BlockSums& sums) {
  const BlockFrame& frame = problem.frames[f];
  const SE3 &T_cam_rig = state.T_cam_rig[view.cam], &T_rig_board = state.T_rig_board[f];
  const Lens& lens = state.lenses[view.cam];
  Gram gram;
  const auto cost = accumulate_view(
      {lens, T_cam_rig * T_rig_board, view.corners, problem.loss, problem.loss_scale}, &gram);
  if (!cost) return false;
  sums.cost += *cost;
  const int n = n_params(lens), lens_at = problem.offsets.lens[view.cam],
            pose_at = problem.offsets.pose[view.cam];
  for (int j = 0; j < n; ++j) {
    for (int i = j; i < n; ++i) sums.A(lens_at + i, lens_at + j) += gram(i, j);
    sums.g[lens_at + j] += gram(n + 6, j);
  }
  const Parts parts(gram, n);
  Couplings A_sf(normal.A_sf.data() + frame.at, frame.n_shared, 6);
  const int lens_row = row_of(frame, lens_at);
  if (T_cam_rig == SE3()) {  // one camera, or the first of a rig: nothing to turn
    normal.A_ff[f] += parts.A_pp;
    normal.g_f[f] += parts.g_p;
    A_sf.middleRows(lens_row, n) += parts.A_lp;
  } else {
    const Mat6 M = step_of_board(T_cam_rig);
    normal.A_ff[f].noalias() += M.transpose() * parts.A_pp * M;
    normal.g_f[f].noalias() += M.transpose() * parts.g_p;
    A_sf.middleRows(lens_row, n).noalias() += parts.A_lp * M;
  }
  if (pose_at < 0) return true;
  const Mat6 M = step_of_camera(T_cam_rig, T_rig_board), A_cp = M.transpose() * parts.A_pp;
  A_sf.middleRows(row_of(frame, pose_at), 6).noalias() += A_cp * step_of_board(T_cam_rig);
  sums.A.block<6, 6>(pose_at, pose_at).noalias() += A_cp * M;
  sums.A.block(pose_at, lens_at, 6, n).noalias() += M.transpose() * parts.A_lp.transpose();
  sums.g.segment<6>(pose_at).noalias() += M.transpose() * parts.g_p;
  return true;
}

void add_segment(std::vector<Segment>& list, int first, int n) {
  for (const Segment& s : list) {
    if (s.first == first) return;
  }
  list.push_back({first, n});
}

}  // namespace

BlockProblem block_problem(const Calibration& cal, const SolveSpec& spec) {
  BlockProblem problem{offsets_of(cal.rig), {},
                       0,                   spec.loss,
                       spec.loss_scale,     std::make_unique<Workers>(spec.n_threads)};
  std::vector<int> place(cal.T_rig_board.size(), -1);
  ViewCorners last;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    const std::vector<Observation> observations = observations_of(cal, v, spec.use_sigma);
    if (observations.empty()) continue;
    const int cam = cal.data.views[v].cam;
    int& at = place[cal.data.views[v].frame];
    if (at < 0) {
      at = static_cast<int>(problem.frames.size());
      problem.frames.emplace_back().frame = cal.data.views[v].frame;
    }
    ViewCorners corners = view_corners(observations, last.points ? &last : nullptr);
    last.n = corners.n;
    last.points = corners.points;
    BlockFrame& frame = problem.frames[at];
    frame.views.push_back({cam, std::move(corners)});
    add_segment(frame.shared, problem.offsets.lens[cam], n_params(cal.rig.cameras[cam].lens));
    if (cam > 0) add_segment(frame.shared, problem.offsets.pose[cam], 6);
  }
  for (BlockFrame& frame : problem.frames) {
    std::sort(frame.shared.begin(), frame.shared.end(),
              [](const Segment& a, const Segment& b) { return a.first < b.first; });
    for (const Segment& s : frame.shared) frame.n_shared += s.n;
    frame.at = problem.n_coupling;
    problem.n_coupling += 6 * static_cast<std::size_t>(frame.n_shared);
  }
  return problem;
}

bool make_normal(const BlockProblem& problem, const BlockState& state, BlockNormal& normal) {
  const Runs runs(problem.frames.size());
  const int n = problem.offsets.total;
  normal.A_ff.assign(problem.frames.size(), Mat6::Zero());
  normal.g_f.assign(problem.frames.size(), Vec6::Zero());
  normal.A_sf.assign(problem.n_coupling, 0.0);
  normal.runs.resize(static_cast<std::size_t>(runs.n_runs));
  problem.workers->run(runs.n_runs, [&](int run) {
    BlockSums& sums = normal.runs[static_cast<std::size_t>(run)];
    sums.ok = true;
    sums.cost = 0;
    sums.A.setZero(n, n);
    sums.g.setZero(n);
    for (int i = runs.first(run); i < runs.first(run + 1); ++i) {
      const auto f = static_cast<std::size_t>(i);
      for (const BlockView& view : problem.frames[f].views)
        sums.ok = sums.ok && add_view(problem, state, f, view, normal, sums);
    }
  });
  normal.cost = 0;
  normal.A_ss.setZero(n, n);
  normal.g_s.setZero(n);
  for (const BlockSums& sums : normal.runs) {
    if (!sums.ok) return false;
    normal.cost += sums.cost;
    normal.A_ss += sums.A;
    normal.g_s += sums.g;
  }
  return std::isfinite(normal.cost);
}

BlockVector gradient(const BlockNormal& normal) { return {normal.g_s, normal.g_f}; }

BlockVector times(const BlockProblem& problem, const BlockNormal& normal, const BlockVector& v) {
  BlockVector out{normal.A_ss.selfadjointView<Eigen::Lower>() * v.shared, {}};
  for (std::size_t f = 0; f < problem.frames.size(); ++f) {
    const BlockFrame& frame = problem.frames[f];
    const Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, 6>> A_sf(normal.A_sf.data() + frame.at,
                                                                          frame.n_shared, 6);
    Vec6 own = normal.A_ff[f] * v.boards[f];
    int row = 0;
    for (const Segment& s : frame.shared) {
      out.shared.segment(s.first, s.n).noalias() += A_sf.middleRows(row, s.n) * v.boards[f];
      own.noalias() += A_sf.middleRows(row, s.n).transpose() * v.shared.segment(s.first, s.n);
      row += s.n;
    }
    out.boards.push_back(own);
  }
  return out;
}

std::optional<BlockVector> mixed_gradient(const BlockProblem& problem, const BlockState& state,
                                          const BlockState& other) {
  const std::size_t n_frames = problem.frames.size();
  const Runs runs(n_frames);
  BlockVector out{VecX::Zero(problem.offsets.total), std::vector<Vec6>(n_frames, Vec6::Zero())};
  std::vector<BlockSums> all(static_cast<std::size_t>(runs.n_runs));
  problem.workers->run(runs.n_runs, [&](int run) {
    BlockSums& sums = all[static_cast<std::size_t>(run)];
    sums.g = VecX::Zero(problem.offsets.total);
    for (int i = runs.first(run); i < runs.first(run + 1) && sums.ok; ++i) {
      const auto f = static_cast<std::size_t>(i);
      for (const BlockView& view : problem.frames[f].views) {
        const SE3& T_cam_rig = state.T_cam_rig[view.cam];
        const Lens& lens = state.lenses[view.cam];
        const auto second = accumulate_second(
            {lens, T_cam_rig * state.T_rig_board[f], view.corners, problem.loss, problem.loss_scale},
            other.lenses[view.cam], other.T_cam_rig[view.cam] * other.T_rig_board[f]);
        if (!second) {
          sums.ok = false;
          break;
        }
        const int n = n_params(lens), pose_at = problem.offsets.pose[view.cam];
        const Vec6 g_p = second->tail<6>();
        sums.g.segment(problem.offsets.lens[view.cam], n) += second->head(n);
        out.boards[f] += step_of_board(T_cam_rig).transpose() * g_p;
        if (pose_at >= 0)
          sums.g.segment<6>(pose_at) += step_of_camera(T_cam_rig, state.T_rig_board[f]).transpose() * g_p;
      }
    }
  });
  for (const BlockSums& sums : all) {
    if (!sums.ok) return std::nullopt;
    out.shared += sums.g;
  }
  return out;
}

}  // namespace plumbline::detail
