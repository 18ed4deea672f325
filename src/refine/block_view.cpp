// SPDX-License-Identifier: Apache-2.0
#include "refine/block_view.hpp"

#include <algorithm>
#include <optional>

namespace plumbline::detail {
namespace {

using CouplingRows = Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 6>>;
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

// The number among the dense parameters of a shared one, -1 for none.
int dense_at(const BlockProblem& problem, int parameter) {
  return parameter < 0 ? -1 : problem.dense[parameter];
}

std::size_t spline_of(const BlockProblem& problem, int cam) {
  std::size_t s = 0;
  while (problem.splines[s].cam != cam) ++s;
  return s;
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

// Adds what a shared pose (of a camera or a board) has with itself, with the lens and with its frame, whose
// rows start at `row`; `at` and `lens_at` count the dense parameters.
void add_shared_pose(int row, int at, int lens_at, const Mat6& M, const Mat6& M_frame, const Parts& parts,
                     CouplingRows& A_sf, BlockSums& sums) {
  const Mat6 A_cp = M.transpose() * parts.A_pp;
  A_sf.middleRows(row, 6).noalias() += A_cp * M_frame;
  sums.A.block<6, 6>(at, at).noalias() += A_cp * M;
  sums.A.block(at, lens_at, 6, parts.A_lp.rows()).noalias() += M.transpose() * parts.A_lp.transpose();
  sums.g.segment<6>(at).noalias() += M.transpose() * parts.g_p;
}

// Adds what a view's control points have with its poses and its board's bow. `sums.control` has their
// products with [focal length, centre | dw dt | residual | bow].
void add_control_points(const BlockProblem& problem, const BlockState& state, const BlockView& view,
                        const SplinePatch& patch, const ViewChain& chain, CouplingRows& A_sf,
                        BlockSums& sums) {
  const std::size_t s = spline_of(problem, view.cam);
  const BlockSpline& spline = problem.splines[s];
  const auto& lens = std::get<Splined>(state.lenses[view.cam]);
  SplineSums& into = sums.splines[s];
  const Eigen::Map<const MatX> control(sums.control.data(), patch.n_rows, spline_columns(view.corners));
  const auto pose = control.middleCols<6>(2);
  if (chain.one_pose)
    A_sf.middleRows(patch.first_row, patch.n_rows) += pose;
  else
    A_sf.middleRows(patch.first_row, patch.n_rows).noalias() += pose * chain.frame;
  for (std::size_t j = 0; j < patch.ranges.size(); ++j) {
    const KnotRange& range = patch.ranges[j];
    const int n = 2 * (range.to - range.from), from = patch.row_of_knots[j] + 2 * range.from,
              to = lens.control_point(range.from, static_cast<int>(j)) - 4;
    if (n == 0) continue;
    const auto rows = control.middleRows(from, n);
    into.g.segment(to, n) += rows.col(8);
    auto strip = into.strip.middleRows(to, n);
    strip.leftCols<2>() += rows.leftCols<2>();
    if (view.cam > 0)
      strip.middleCols<6>(spline.column_of(problem.offsets.pose[view.cam])).noalias() +=
          rows.middleCols<6>(2) * chain.camera;
    if (view.target > 0)
      strip.middleCols<6>(spline.column_of(problem.offsets.board[view.target])).noalias() +=
          rows.middleCols<6>(2) * chain.board;
    if (view.corners.bowed)
      strip.middleCols<2>(spline.column_of(problem.offsets.bow[view.target])) += rows.middleCols<2>(9);
  }
}

// The gram of one view over its lens' dense parameters, and their number; nullopt outside the lens' domain.
struct Accumulated {
  Gram gram;
  double cost;
  int n_dense;
};
std::optional<Accumulated> accumulate(const BlockProblem& problem, const BlockState& state, std::size_t f,
                                      const BlockView& view, const ViewChain& chain, BlockNormal& normal,
                                      CouplingRows& A_sf, BlockSums& sums) {
  const Lens& lens = state.lenses[view.cam];
  const ViewQuestion question{lens,         chain.T_cam_board,  view.corners,
                              problem.loss, problem.loss_scale, state.bow_m[view.target]};
  Accumulated result;
  result.n_dense = is_sparse(lens) ? 4 : n_params(lens);
  std::optional<double> cost;
  if (!is_sparse(lens)) {
    cost = accumulate_view(question, &result.gram);
  } else {
    const auto& patches = coupling_of(problem, normal, f).patches;
    const SplinePatch& patch = *std::find_if(patches.begin(), patches.end(),
                                             [&](const SplinePatch& p) { return p.cam == view.cam; });
    sums.control.assign(static_cast<std::size_t>(patch.n_rows * spline_columns(view.corners) + kSplineSlack),
                        0.0);
    cost = accumulate_spline(question, &normal.knots[view.knots_at], patch, result.gram,
                             sums.splines[spline_of(problem, view.cam)].band, sums.control);
    if (cost) add_control_points(problem, state, view, patch, chain, A_sf, sums);
  }
  if (!cost) return std::nullopt;
  result.cost = *cost;
  return result;
}

// Adds what the bow of a view's board, whose rows are the gram's last two, has with everything else. \param n
// lens parameters
void add_bow(const BlockProblem& problem, const Coupling& coupling, const BlockView& view,
             const ViewChain& chain, const Gram& gram, int n, CouplingRows& A_sf, BlockSums& sums) {
  using Rows = Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::ColMajor, 2, Gram::kMost>;
  Rows rows(2, n + 9);
  for (int j = 0; j < n + 9; ++j) {
    rows(0, j) = j < n + 8 ? gram(n + 7, j) : gram(n + 8, n + 7);
    rows(1, j) = gram(n + 8, j);
  }
  const int bow = problem.offsets.bow[view.target], at = problem.dense[bow],
            camera_at = dense_at(problem, problem.offsets.pose[view.cam]),
            board_at = dense_at(problem, problem.offsets.board[view.target]);
  const Eigen::Matrix<double, 2, 6> A_bp = rows.middleCols<6>(n);
  // Bows come after lenses, cameras and boards: the lower triangle.
  sums.A.block(at, problem.dense[problem.offsets.lens[view.cam]], 2, n) += rows.leftCols(n);
  sums.A.block<2, 2>(at, at) += rows.rightCols<2>();
  sums.g.segment<2>(at) += rows.col(n + 6);
  if (chain.one_pose)
    A_sf.middleRows<2>(row_of(coupling, bow)) += A_bp;
  else
    A_sf.middleRows<2>(row_of(coupling, bow)).noalias() += A_bp * chain.frame;
  if (camera_at >= 0) sums.A.block<2, 6>(at, camera_at).noalias() += A_bp * chain.camera;
  if (board_at >= 0) sums.A.block<2, 6>(at, board_at).noalias() += A_bp * chain.board;
}

}  // namespace

bool add_view(const BlockProblem& problem, const BlockState& state, std::size_t f, const BlockView& view,
              BlockNormal& normal, BlockSums& sums) {
  const Coupling& coupling = coupling_of(problem, normal, f);
  const ViewChain chain(state, view, f);
  CouplingRows A_sf(normal.A_sf.data() + coupling.at, coupling.n_rows, 6);
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
  if (view.corners.bowed) add_bow(problem, coupling, view, chain, gram, n, A_sf, sums);
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
  const int camera_at = dense_at(problem, camera), board_at = dense_at(problem, board);
  if (camera >= 0)
    add_shared_pose(row_of(coupling, camera), camera_at, lens_at, chain.camera, chain.frame, parts, A_sf,
                    sums);
  if (board >= 0)
    add_shared_pose(row_of(coupling, board), board_at, lens_at, chain.board, chain.frame, parts, A_sf, sums);
  if (camera >= 0 && board >= 0)  // boards come after cameras: the lower triangle
    sums.A.block<6, 6>(board_at, camera_at).noalias() += chain.board.transpose() * parts.A_pp * chain.camera;
  return true;
}

SE3 pose_in_camera(const BlockState& state, const BlockView& view, std::size_t f) {
  return ViewChain(state, view, f).T_cam_board;
}

}  // namespace plumbline::detail
