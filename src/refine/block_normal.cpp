// SPDX-License-Identifier: Apache-2.0
#include "refine/block_normal.hpp"

#include <cmath>
#include <utility>

#include "refine/block_extras.hpp"
#include "refine/block_runs.hpp"
#include "refine/block_view.hpp"

namespace plumbline::detail {
namespace {

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
  int column = 2;
  for (const Segment& shared : spline.shared) {
    normal.A_ss.block(shared.first, control_at, shared.n, n) +=
        sums.strip.middleCols(column, shared.n).transpose();
    column += shared.n;
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
    if (splines.empty())
      splines = sums.splines;
    else
      for (std::size_t s = 0; s < splines.size(); ++s) splines[s].add(sums.splines[s]);
  }
  if (A.rows() == problem.offsets.total) {
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

}  // namespace

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
      sums.splines[s].clear(std::get<Splined>(state.lenses[spline.cam]), spline.column_of(-1));
    }
    for (int i = runs.first(run); i < runs.first(run + 1); ++i) {
      const auto f = static_cast<std::size_t>(i);
      for (const BlockView& view : problem.frames[f].views)
        sums.ok = sums.ok && add_view(problem, state, f, view, normal, sums);
    }
  });
  normal.cost = 0;
  if (!add_runs(problem, state, normal)) return false;
  add_extras(problem, state, normal);
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
        const ViewChain chain(state, view, f), ahead(other, view, f);
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
