// SPDX-License-Identifier: Apache-2.0
#include "refine/block_normal.hpp"

#include <algorithm>
#include <cmath>

#include "plumbline/geometry/so3.hpp"
#include "plumbline/rig/calibration.hpp"
#include "refine/block_extras.hpp"
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

// How steps of the three poses of a view's chain move its board in the camera's frame, as the kernel's
// [dw | dt] sees it. p_cam = T_cam_rig T_rig_board T_board0_board p, each stepped by box_plus().
struct Chain {
  SE3 T_cam_board;
  Mat6 camera, frame, board;  // d[dw | dt] / d(step)
  bool one_pose;              // the first camera's view of the first board: `frame` is the identity

  Chain(const BlockState& state, const BlockView& view, std::size_t f) {
    const SE3 &T_cam_rig = state.T_cam_rig[view.cam], &T_rig_board = state.T_rig_board[f];
    one_pose = view.target == 0 && view.cam == 0 && T_cam_rig == SE3();
    if (one_pose) {
      T_cam_board = T_rig_board;
      return;
    }
    const SE3& T_board0_board = state.T_board0_board[view.target];
    const SE3 T_rig_this = T_rig_board * T_board0_board;
    T_cam_board = T_cam_rig * T_rig_this;
    const Mat3 R = T_cam_rig.R();
    camera = Mat6::Identity();  // also swings the board about the camera's centre
    camera.bottomLeftCorner<3, 3>() = -skew(R * T_rig_this.t());
    frame.setZero();
    frame.topLeftCorner<3, 3>() = frame.bottomRightCorner<3, 3>() = R;
    // Also swings this board about the first one's origin.
    frame.bottomLeftCorner<3, 3>() = -R * skew(T_rig_board.R() * T_board0_board.t());
    board.setZero();
    board.topLeftCorner<3, 3>() = board.bottomRightCorner<3, 3>() = R * T_rig_board.R();
  }
};

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

// Adds what a shared pose (of a camera or a board) has with itself, with the lens and with its frame.
void add_shared_pose(const BlockFrame& frame, int at, int lens_at, const Mat6& M, const Mat6& M_frame,
                     const Parts& parts, Couplings& A_sf, BlockSums& sums) {
  const Mat6 A_cp = M.transpose() * parts.A_pp;
  A_sf.middleRows(row_of(frame, at), 6).noalias() += A_cp * M_frame;
  sums.A.block<6, 6>(at, at).noalias() += A_cp * M;
  sums.A.block(at, lens_at, 6, parts.A_lp.rows()).noalias() += M.transpose() * parts.A_lp.transpose();
  sums.g.segment<6>(at).noalias() += M.transpose() * parts.g_p;
}

// Adds what the bow of a view's board, whose rows are the gram's last two, has with everything else. \param n
// lens parameters
void add_bow(const BlockProblem& problem, const BlockFrame& frame, const BlockView& view, const Chain& chain,
             const Gram& gram, int n, Couplings& A_sf, BlockSums& sums) {
  using Rows = Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::ColMajor, 2, Gram::kMost>;
  Rows rows(2, n + 9);
  for (int j = 0; j < n + 9; ++j) {
    rows(0, j) = j < n + 8 ? gram(n + 7, j) : gram(n + 8, n + 7);
    rows(1, j) = gram(n + 8, j);
  }
  const int at = problem.offsets.bow[view.target], camera_at = problem.offsets.pose[view.cam],
            board_at = problem.offsets.board[view.target];
  const Eigen::Matrix<double, 2, 6> A_bp = rows.middleCols<6>(n);
  // Bows come after lenses, cameras and boards: the lower triangle.
  sums.A.block(at, problem.offsets.lens[view.cam], 2, n) += rows.leftCols(n);
  sums.A.block<2, 2>(at, at) += rows.rightCols<2>();
  sums.g.segment<2>(at) += rows.col(n + 6);
  if (chain.one_pose)
    A_sf.middleRows<2>(row_of(frame, at)) += A_bp;
  else
    A_sf.middleRows<2>(row_of(frame, at)).noalias() += A_bp * chain.frame;
  if (camera_at >= 0) sums.A.block<2, 6>(at, camera_at).noalias() += A_bp * chain.camera;
  if (board_at >= 0) sums.A.block<2, 6>(at, board_at).noalias() += A_bp * chain.board;
}

// Adds one view: its frame's own blocks to `normal`, what is shared to `sums`.
bool add_view(const BlockProblem& problem, const BlockState& state, std::size_t f, const BlockView& view,
              BlockNormal& normal, BlockSums& sums) {
  const BlockFrame& frame = problem.frames[f];
  const Chain chain(state, view, f);
  const Lens& lens = state.lenses[view.cam];
  Gram gram;
  const auto cost = accumulate_view(
      {lens, chain.T_cam_board, view.corners, problem.loss, problem.loss_scale, state.bow_m[view.target]},
      &gram);
  if (!cost) return false;
  sums.cost += *cost;
  const int n = n_params(lens), lens_at = problem.offsets.lens[view.cam];
  for (int j = 0; j < n; ++j) {
    for (int i = j; i < n; ++i) sums.A(lens_at + i, lens_at + j) += gram(i, j);
    sums.g[lens_at + j] += gram(n + 6, j);
  }
  const Parts parts(gram, n);
  Couplings A_sf(normal.A_sf.data() + frame.at, frame.n_shared, 6);
  const int lens_row = row_of(frame, lens_at);
  if (view.corners.bowed) add_bow(problem, frame, view, chain, gram, n, A_sf, sums);
  if (chain.one_pose) {
    normal.A_ff[f] += parts.A_pp;
    normal.g_f[f] += parts.g_p;
    A_sf.middleRows(lens_row, n) += parts.A_lp;
    return true;
  }
  normal.A_ff[f].noalias() += chain.frame.transpose() * parts.A_pp * chain.frame;
  normal.g_f[f].noalias() += chain.frame.transpose() * parts.g_p;
  A_sf.middleRows(lens_row, n).noalias() += parts.A_lp * chain.frame;
  const int camera_at = problem.offsets.pose[view.cam], board_at = problem.offsets.board[view.target];
  if (camera_at >= 0)
    add_shared_pose(frame, camera_at, lens_at, chain.camera, chain.frame, parts, A_sf, sums);
  if (board_at >= 0) add_shared_pose(frame, board_at, lens_at, chain.board, chain.frame, parts, A_sf, sums);
  if (camera_at >= 0 && board_at >= 0)  // boards come after cameras: the lower triangle
    sums.A.block<6, 6>(board_at, camera_at).noalias() += chain.board.transpose() * parts.A_pp * chain.camera;
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
  BlockProblem problem;
  problem.offsets = offsets_of(cal);
  problem.loss = spec.loss;
  problem.loss_scale = spec.loss_scale;
  problem.spec = &spec;
  problem.workers = std::make_unique<Workers>(spec.n_threads);
  if (!spec.priors.empty()) {
    problem.shared_only.rig = cal.rig;
    problem.shared_only.data.targets = cal.data.targets;
    problem.shared_only.bow_m = cal.bow_m;
  }
  std::vector<int> place(cal.T_rig_board.size(), -1);
  ViewCorners last;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    const std::vector<Observation> observations = observations_of(cal, v, spec.use_sigma);
    if (observations.empty()) continue;
    const int cam = cal.data.views[v].cam, target = cal.data.views[v].target;
    int& at = place[cal.data.views[v].frame];
    if (at < 0) {
      at = static_cast<int>(problem.frames.size());
      problem.frames.emplace_back().frame = cal.data.views[v].frame;
    }
    const bool bowed = problem.offsets.bow[target] >= 0;
    ViewCorners corners = view_corners(observations, last.points ? &last : nullptr, bowed);
    last.n = corners.n;
    last.points = corners.points;
    BlockFrame& frame = problem.frames[at];
    frame.views.push_back({cam, target, std::move(corners)});
    add_segment(frame.shared, problem.offsets.lens[cam], n_params(cal.rig.cameras[cam].lens));
    if (cam > 0) add_segment(frame.shared, problem.offsets.pose[cam], 6);
    if (target > 0) add_segment(frame.shared, problem.offsets.board[target], 6);
    if (bowed) add_segment(frame.shared, problem.offsets.bow[target], 2);
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
  add_extras(problem, state, normal);
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
        const Chain chain(state, view, f), ahead(other, view, f);
        const Lens& lens = state.lenses[view.cam];
        const auto second =
            accumulate_second({lens, chain.T_cam_board, view.corners, problem.loss, problem.loss_scale,
                               state.bow_m[view.target]},
                              other.lenses[view.cam], ahead.T_cam_board, other.bow_m[view.target]);
        if (!second) {
          sums.ok = false;
          break;
        }
        const int n = n_params(lens), camera_at = problem.offsets.pose[view.cam],
                  board_at = problem.offsets.board[view.target];
        const Vec6 g_p = second->segment<6>(n);
        sums.g.segment(problem.offsets.lens[view.cam], n) += second->head(n);
        out.boards[f] += chain.one_pose ? g_p : Vec6(chain.frame.transpose() * g_p);
        if (camera_at >= 0) sums.g.segment<6>(camera_at) += chain.camera.transpose() * g_p;
        if (board_at >= 0) sums.g.segment<6>(board_at) += chain.board.transpose() * g_p;
        if (view.corners.bowed) sums.g.segment<2>(problem.offsets.bow[view.target]) += second->tail<2>();
      }
    }
  });
  for (const BlockSums& sums : all) {
    if (!sums.ok) return std::nullopt;
    out.shared += sums.g;
  }
  add_mixed_extras(problem, state, other, out.shared);
  return out;
}

}  // namespace plumbline::detail
