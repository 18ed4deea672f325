// SPDX-License-Identifier: Apache-2.0
#include "refine/block_normal.hpp"

#include <algorithm>
#include <cmath>

#include "plumbline/geometry/so3.hpp"
#include "refine/block_runs.hpp"
#include "refine/sparse_cost.hpp"

namespace plumbline::detail {
namespace {

using Couplings = Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 6>>;
using LensRows = Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::ColMajor, kMaxLensParams, 6>;

// Row of a shared parameter in the couplings of a frame.
int row_of(const Coupling& coupling, int parameter) {
  int row = 0;
  for (const Segment& s : coupling.segments) {
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

// Adds what a shared pose (of a camera or a board) has with itself, with the lens and with its frame, whose
// rows start at `row`; `at` and `lens_at` count the dense parameters.
void add_shared_pose(int row, int at, int lens_at, const Mat6& M, const Mat6& M_frame, const Parts& parts,
                     Couplings& A_sf, BlockSums& sums) {
  const Mat6 A_cp = M.transpose() * parts.A_pp;
  A_sf.middleRows(row, 6).noalias() += A_cp * M_frame;
  sums.A.block<6, 6>(at, at).noalias() += A_cp * M;
  sums.A.block(at, lens_at, 6, parts.A_lp.rows()).noalias() += M.transpose() * parts.A_lp.transpose();
  sums.g.segment<6>(at).noalias() += M.transpose() * parts.g_p;
}

// Adds what a view's control points have with its poses. `sums.control` has their products with
// [focal length, centre | dw dt | residual].
void add_control_points(const BlockProblem& problem, const BlockState& state, const BlockView& view,
                        const SplinePatch& patch, const Chain& chain, Couplings& A_sf, BlockSums& sums) {
  std::size_t s = 0;
  while (problem.splines[s].cam != view.cam) ++s;
  const auto& lens = std::get<Splined>(state.lenses[view.cam]);
  SplineSums& into = sums.splines[s];
  const auto pose = sums.control.middleCols<6>(2);
  if (chain.one_pose)
    A_sf.middleRows(patch.first_row, patch.n_rows) += pose;
  else
    A_sf.middleRows(patch.first_row, patch.n_rows).noalias() += pose * chain.frame;
  for (std::size_t j = 0; j < patch.ranges.size(); ++j) {
    const KnotRange& range = patch.ranges[j];
    const int n = 2 * (range.to - range.from), from = patch.row_of_knots[j] + 2 * range.from,
              to = lens.control_point(range.from, static_cast<int>(j)) - 4;
    if (n == 0) continue;
    const auto rows = sums.control.middleRows(from, n);
    into.g.segment(to, n) += rows.col(8);
    auto strip = into.strip.middleRows(to, n);
    strip.leftCols<2>() += rows.leftCols<2>();
    int column = 2;
    if (view.cam > 0) {
      strip.middleCols<6>(column).noalias() += rows.middleCols<6>(2) * chain.camera;
      column += 6;
    }
    if (view.target > 0)
      strip.middleCols<6>(column + 6 * (view.target - 1)).noalias() += rows.middleCols<6>(2) * chain.board;
  }
}

// The gram of one view over its lens' dense parameters, and their number; nullopt outside the lens' domain.
struct Accumulated {
  Gram gram;
  double cost;
  int n_dense;
};
std::optional<Accumulated> accumulate(const BlockProblem& problem, const BlockState& state, std::size_t f,
                                      const BlockView& view, const Chain& chain, BlockNormal& normal,
                                      Couplings& A_sf, BlockSums& sums) {
  const Lens& lens = state.lenses[view.cam];
  const ViewQuestion question{lens, chain.T_cam_board, view.corners, problem.loss, problem.loss_scale};
  Accumulated result;
  result.n_dense = is_sparse(lens) ? 4 : n_params(lens);
  std::optional<double> cost;
  if (!is_sparse(lens)) {
    cost = accumulate_view(question, &result.gram);
  } else {
    const auto& patches = coupling_of(problem, normal, f).patches;
    const SplinePatch& patch = *std::find_if(patches.begin(), patches.end(),
                                             [&](const SplinePatch& p) { return p.cam == view.cam; });
    sums.control.setZero(patch.n_rows, kSplineColumns);
    std::size_t s = 0;
    while (problem.splines[s].cam != view.cam) ++s;
    cost = accumulate_spline(question, &normal.knots[view.knots_at], patch, result.gram, sums.splines[s].band,
                             sums.control);
    if (cost) add_control_points(problem, state, view, patch, chain, A_sf, sums);
  }
  if (!cost) return std::nullopt;
  result.cost = *cost;
  return result;
}

// Adds one view: its frame's own blocks to `normal`, what is shared to `sums`.
bool add_view(const BlockProblem& problem, const BlockState& state, std::size_t f, const BlockView& view,
              BlockNormal& normal, BlockSums& sums) {
  const Coupling& coupling = coupling_of(problem, normal, f);
  const Chain chain(state, view, f);
  Couplings A_sf(normal.A_sf.data() + coupling.at, coupling.n_rows, 6);
  const auto accumulated = accumulate(problem, state, f, view, chain, normal, A_sf, sums);
  if (!accumulated) return false;
  const Gram& gram = accumulated->gram;
  sums.cost += accumulated->cost;
  const int n = accumulated->n_dense, lens_row = row_of(coupling, problem.offsets.lens[view.cam]),
            lens_at = problem.dense[problem.offsets.lens[view.cam]];
  for (int j = 0; j < n; ++j) {
    for (int i = j; i < n; ++i) sums.A(lens_at + i, lens_at + j) += gram(i, j);
    sums.g[lens_at + j] += gram(n + 6, j);
  }
  const Parts parts(gram, n);
  if (chain.one_pose) {
    normal.A_ff[f] += parts.A_pp;
    normal.g_f[f] += parts.g_p;
    A_sf.middleRows(lens_row, n) += parts.A_lp;
    return true;
  }
  normal.A_ff[f].noalias() += chain.frame.transpose() * parts.A_pp * chain.frame;
  normal.g_f[f].noalias() += chain.frame.transpose() * parts.g_p;
  A_sf.middleRows(lens_row, n).noalias() += parts.A_lp * chain.frame;
  const int camera = problem.offsets.pose[view.cam], board = problem.offsets.board[view.target];
  const int camera_at = camera < 0 ? -1 : problem.dense[camera],
            board_at = board < 0 ? -1 : problem.dense[board];
  if (camera >= 0)
    add_shared_pose(row_of(coupling, camera), camera_at, lens_at, chain.camera, chain.frame, parts, A_sf,
                    sums);
  if (board >= 0)
    add_shared_pose(row_of(coupling, board), board_at, lens_at, chain.board, chain.frame, parts, A_sf, sums);
  if (camera >= 0 && board >= 0)  // boards come after cameras: the lower triangle
    sums.A.block<6, 6>(board_at, camera_at).noalias() += chain.board.transpose() * parts.A_pp * chain.camera;
  return true;
}

PriorRows priors_at(const BlockProblem& problem, const BlockState& state) {
  Calibration cal = problem.shared_only;
  for (std::size_t i = 0; i < state.lenses.size(); ++i) cal.rig.cameras[i].lens = state.lenses[i];
  cal.rig.T_cam_rig = state.T_cam_rig;
  cal.T_board0_board = state.T_board0_board;
  return prior_rows(cal, *problem.spec);
}

// Adds the sums of one splined lens to the equations of all.
void expand_spline(const BlockProblem& problem, const BlockState& state, const BlockSpline& spline,
                   const SplineSums& sums, BlockNormal& normal) {
  const Lens& lens = state.lenses[spline.cam];
  const auto& splined = std::get<Splined>(lens);
  const int lens_at = problem.offsets.lens[spline.cam], n = n_params(lens) - 4, control_at = lens_at + 4;
  expand_band(splined, sums.band, lens_at, normal.A_ss);
  normal.g_s.segment(control_at, n) += sums.g;
  for (int i = 0; i < n; ++i) {
    // x with fx and cx, y with fy and cy
    normal.A_ss(control_at + i, lens_at + i % 2) += sums.strip(i, 0);
    normal.A_ss(control_at + i, lens_at + 2 + i % 2) += sums.strip(i, 1);
  }
  std::vector<int> poses = problem.offsets.board;
  poses[0] = problem.offsets.pose[spline.cam];
  int column = 2;
  for (int at : poses) {
    if (at < 0) continue;
    normal.A_ss.block(at, control_at, 6, n) += sums.strip.middleCols<6>(column).transpose();
    column += 6;
  }
  normal.cost += add_regularisation(lens, spline.prior_scale, lens_at, normal.A_ss, normal.g_s);
}

// The sums of all runs, in their order.
bool add_runs(const BlockProblem& problem, const BlockState& state, BlockNormal& normal) {
  std::vector<SplineSums> splines;
  MatX A = MatX::Zero(static_cast<Eigen::Index>(problem.from_dense.size()),
                      static_cast<Eigen::Index>(problem.from_dense.size()));
  VecX g = VecX::Zero(A.rows());
  for (const BlockSums& sums : normal.runs) {
    if (!sums.ok) return false;
    normal.cost += sums.cost;
    A += sums.A;
    g += sums.g;
    if (splines.empty()) {
      splines = sums.splines;
      continue;
    }
    for (std::size_t s = 0; s < splines.size(); ++s) splines[s].add(sums.splines[s]);
  }
  if (splines.empty()) {
    normal.A_ss = std::move(A);
    normal.g_s = std::move(g);
    return true;
  }
  const int n = problem.offsets.total;
  normal.A_ss.setZero(n, n);
  normal.g_s.setZero(n);
  for (int j = 0; j < A.cols(); ++j) {
    normal.g_s[problem.from_dense[j]] = g[j];
    for (int i = j; i < A.rows(); ++i) normal.A_ss(problem.from_dense[i], problem.from_dense[j]) = A(i, j);
  }
  for (std::size_t s = 0; s < splines.size(); ++s)
    expand_spline(problem, state, problem.splines[s], splines[s], normal);
  return true;
}

void add_segment(std::vector<Segment>& list, int first, int n) {
  for (const Segment& s : list) {
    if (s.first == first) return;
  }
  list.push_back({first, n});
}

// Which parameters are dense, and how much each spline's regularisation weighs.
void divide_parameters(const Calibration& cal, const std::vector<int>& n_residuals, BlockProblem& problem) {
  problem.dense.assign(static_cast<std::size_t>(problem.offsets.total), 0);
  for (std::size_t i = 0; i < cal.rig.cameras.size(); ++i) {
    const Lens& lens = cal.rig.cameras[i].lens;
    if (!is_sparse(lens)) continue;
    const auto first = problem.dense.begin() + problem.offsets.lens[i];
    std::fill(first + 4, first + n_params(lens), -1);
    if (n_residuals[i] == 0) continue;
    const int n_further = static_cast<int>(cal.data.targets.size()) - 1;
    problem.splines.push_back({static_cast<int>(i), 2 + (i > 0 ? 6 : 0) + 6 * n_further,
                               prior_scale(n_residuals[i], n_params(lens))});
  }
  for (int i = 0; i < problem.offsets.total; ++i) {
    if (problem.dense[i] < 0) continue;
    problem.dense[i] = static_cast<int>(problem.from_dense.size());
    problem.from_dense.push_back(i);
  }
}

}  // namespace

void Coupling::finish(std::size_t& n_before) {
  n_rows = 0;
  for (const Segment& s : segments) n_rows += s.n;
  at = n_before;
  n_before += 6 * static_cast<std::size_t>(n_rows);
}

SE3 pose_in_camera(const BlockState& state, const BlockView& view, std::size_t f) {
  return Chain(state, view, f).T_cam_board;
}

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
  }
  std::vector<int> place(cal.T_rig_board.size(), -1);
  ViewCorners last;
  std::vector<int> n_residuals(cal.rig.cameras.size(), 0);
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    const std::vector<Observation> observations = observations_of(cal, v, spec.use_sigma);
    if (observations.empty()) continue;
    const int cam = cal.data.views[v].cam, target = cal.data.views[v].target;
    int& at = place[cal.data.views[v].frame];
    if (at < 0) {
      at = static_cast<int>(problem.frames.size());
      problem.frames.emplace_back().frame = cal.data.views[v].frame;
      problem.couplings.emplace_back();
    }
    ViewCorners corners = view_corners(observations, last.points ? &last : nullptr);
    last.n = corners.n;
    last.points = corners.points;
    const Lens& lens = cal.rig.cameras[cam].lens;
    std::vector<Segment>& segments = problem.couplings[at].segments;
    n_residuals[cam] += 2 * corners.n;
    add_segment(segments, problem.offsets.lens[cam], is_sparse(lens) ? 4 : n_params(lens));
    if (cam > 0) add_segment(segments, problem.offsets.pose[cam], 6);
    if (target > 0) add_segment(segments, problem.offsets.board[target], 6);
    problem.frames[at].views.push_back({cam, target, std::move(corners), problem.n_knots});
    if (is_sparse(lens))
      problem.n_knots += 2 * static_cast<std::size_t>(problem.frames[at].views.back().corners.n);
  }
  for (Coupling& coupling : problem.couplings) {
    std::sort(coupling.segments.begin(), coupling.segments.end(),
              [](const Segment& a, const Segment& b) { return a.first < b.first; });
    coupling.finish(problem.n_coupling);
  }
  divide_parameters(cal, n_residuals, problem);
  return problem;
}

bool make_normal(const BlockProblem& problem, const BlockState& state, BlockNormal& normal) {
  const Runs runs(problem.frames.size());
  const auto n = static_cast<Eigen::Index>(problem.from_dense.size());
  if (!problem.splines.empty() && !couple_splines(problem, state, normal)) return false;
  normal.A_ff.assign(problem.frames.size(), Mat6::Zero());
  normal.g_f.assign(problem.frames.size(), Vec6::Zero());
  const std::size_t n_coupling =
      normal.couplings.empty()
          ? problem.n_coupling
          : normal.couplings.back().at + 6 * static_cast<std::size_t>(normal.couplings.back().n_rows);
  normal.A_sf.assign(n_coupling, 0.0);
  normal.runs.resize(static_cast<std::size_t>(runs.n_runs));
  problem.workers->run(runs.n_runs, [&](int run) {
    BlockSums& sums = normal.runs[static_cast<std::size_t>(run)];
    sums.ok = true;
    sums.cost = 0;
    sums.A.setZero(n, n);
    sums.g.setZero(n);
    sums.splines.resize(problem.splines.size());
    for (std::size_t s = 0; s < sums.splines.size(); ++s) {
      const BlockSpline& spline = problem.splines[s];
      sums.splines[s].clear(std::get<Splined>(state.lenses[spline.cam]), spline.n_columns);
    }
    for (int i = runs.first(run); i < runs.first(run + 1); ++i) {
      const auto f = static_cast<std::size_t>(i);
      for (const BlockView& view : problem.frames[f].views)
        sums.ok = sums.ok && add_view(problem, state, f, view, normal, sums);
    }
  });
  normal.cost = 0;
  if (!add_runs(problem, state, normal)) return false;
  if (!problem.spec->priors.empty()) {
    const PriorRows rows = priors_at(problem, state);
    normal.cost += 0.5 * rows.r.squaredNorm();
    normal.A_ss += rows.J.transpose() * rows.J;
    normal.g_s += rows.J.transpose() * rows.r;
  }
  return std::isfinite(normal.cost);
}

BlockVector gradient(const BlockNormal& normal) { return {normal.g_s, normal.g_f}; }

BlockVector times(const BlockProblem& problem, const BlockNormal& normal, const BlockVector& v) {
  BlockVector out{normal.A_ss.selfadjointView<Eigen::Lower>() * v.shared, {}};
  for (std::size_t f = 0; f < problem.frames.size(); ++f) {
    const Coupling& coupling = coupling_of(problem, normal, f);
    const Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, 6>> A_sf(normal.A_sf.data() + coupling.at,
                                                                          coupling.n_rows, 6);
    Vec6 own = normal.A_ff[f] * v.boards[f];
    int row = 0;
    for (const Segment& s : coupling.segments) {
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
            accumulate_second({lens, chain.T_cam_board, view.corners, problem.loss, problem.loss_scale},
                              other.lenses[view.cam], ahead.T_cam_board);
        if (!second) {
          sums.ok = false;
          break;
        }
        const int n = n_params(lens), camera_at = problem.offsets.pose[view.cam],
                  board_at = problem.offsets.board[view.target];
        const Vec6 g_p = second->tail<6>();
        sums.g.segment(problem.offsets.lens[view.cam], n) += second->head(n);
        out.boards[f] += chain.one_pose ? g_p : Vec6(chain.frame.transpose() * g_p);
        if (camera_at >= 0) sums.g.segment<6>(camera_at) += chain.camera.transpose() * g_p;
        if (board_at >= 0) sums.g.segment<6>(board_at) += chain.board.transpose() * g_p;
      }
    }
  });
  for (const BlockSums& sums : all) {
    if (!sums.ok) return std::nullopt;
    out.shared += sums.g;
  }
  if (!problem.spec->priors.empty())
    out.shared += priors_at(problem, state).J.transpose() * priors_at(problem, other).r;
  return out;
}

}  // namespace plumbline::detail
