// SPDX-License-Identifier: Apache-2.0
#include <ceres/cost_function.h>

#include <algorithm>
#include <cmath>

#include "plumbline/core/linalg.hpp"
#include "plumbline/rig/motion.hpp"
#include "refine/moving_solve.hpp"
#include "refine/reduced.hpp"

namespace plumbline::detail {

namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

struct ViewJacobian {
  VecX r;
  RowMajor lens, cam, board, further;  // the last of a further board's T_board0_board, or empty
  RowMajor bow;                        // or empty
};

std::optional<ViewJacobian> view_jacobian(const Calibration& cal, std::size_t v, const SolveSpec& spec) {
  std::vector<Observation> observations = observations_of(cal, v, spec.use_sigma);
  if (observations.empty()) return std::nullopt;
  const View& view = cal.data.views[v];
  const Lens& lens = cal.rig.cameras[view.cam].lens;
  const auto n = static_cast<Eigen::Index>(2 * observations.size());
  const bool further = view.target > 0;
  auto bow = bow_of(cal, view.target);
  ViewJacobian J{VecX(n),        RowMajor(n, n_params(lens)),  RowMajor(n, 7),
                 RowMajor(n, 7), RowMajor(further ? n : 0, 7), RowMajor(bow ? n : 0, 2)};
  const auto cost =
      make_view_cost(lens, std::move(observations), spec.loss, spec.loss_scale, further, bow.has_value());
  std::vector<const double*> blocks{params(lens).data(), cal.rig.T_cam_rig[view.cam].qt.data(),
                                    cal.T_rig_board[view.frame]->qt.data()};
  std::vector<double*> jacobians{J.lens.data(), J.cam.data(), J.board.data()};
  if (further) {
    blocks.push_back(cal.T_board0_board[view.target].qt.data());
    jacobians.push_back(J.further.data());
  }
  if (bow) {
    blocks.push_back(bow->data());
    jacobians.push_back(J.bow.data());
  }
  if (!cost->Evaluate(blocks.data(), J.r.data(), jacobians.data())) return std::nullopt;
  return J;
}

// All views of one frame: d(r)/d(board pose) in the first six columns, d(r)/d(shared parameters) in the
// others, r in the last.
struct FrameJacobian {
  MatX J;
  double sum = 0;  // of squared residuals
};

FrameJacobian frame_jacobian(const Calibration& cal, const std::vector<int>& views, const Offsets& offsets,
                             const SolveSpec& spec) {
  std::vector<std::pair<const View*, ViewJacobian>> parts;
  Eigen::Index n_rows = 0;
  for (int v : views) {
    if (auto J = view_jacobian(cal, v, spec)) {
      n_rows += J->r.size();
      parts.emplace_back(&cal.data.views[v], *std::move(J));
    }
  }
  FrameJacobian frame{MatX::Zero(n_rows, 6 + offsets.total + 1), 0};
  Eigen::Index row = 0;
  for (const auto& [view, part] : parts) {
    const int cam = view->cam, target = view->target;
    const Eigen::Index n = part.r.size();
    frame.J.block(row, 0, n, 6) = part.board.leftCols(6);
    frame.J.block(row, 6 + offsets.lens[cam], n, part.lens.cols()) = part.lens;
    if (offsets.pose[cam] >= 0) frame.J.block(row, 6 + offsets.pose[cam], n, 6) = part.cam.leftCols(6);
    if (target > 0) frame.J.block(row, 6 + offsets.board[target], n, 6) = part.further.leftCols(6);
    if (offsets.bow[target] >= 0) frame.J.block(row, 6 + offsets.bow[target], n, 2) = part.bow;
    frame.J.col(6 + offsets.total).segment(row, n) = part.r;
    frame.sum += part.r.squaredNorm();
    row += n;
  }
  return frame;
}

// Makes the last columns orthogonal to the first six (modified Gram-Schmidt, twice, which is enough: Giraud,
// Langou, Rozloznik 2005). Then S = J_s' J_s of what is left: the Schur complement without the cancellation
// that H_ss - H_sf H_ff^-1 H_fs suffers, which would hide flat directions of a rational lens behind rounding.
void project_out_pose(MatX& J) {
  for (int pass = 0; pass < 2; ++pass) {
    for (int k = 0; k < 6; ++k) {
      const double norm = J.col(k).norm();
      if (!(norm > 0)) continue;
      J.col(k) /= norm;
      for (Eigen::Index i = k + 1; i < J.cols(); ++i) J.col(i) -= J.col(k).dot(J.col(i)) * J.col(k);
    }
  }
}

}  // namespace

void for_each_pose_free_frame(const Calibration& cal, const SolveSpec& spec,
                              const std::function<void(const PoseFreeFrame&)>& take) {
  const Offsets offsets = offsets_of(cal);
  std::vector<std::vector<int>> views_of(cal.T_rig_board.size());
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    if (takes_part(cal, v)) views_of[cal.data.views[v].frame].push_back(static_cast<int>(v));
  }
  for (std::size_t f = 0; f < views_of.size(); ++f) {
    if (views_of[f].empty()) continue;
    FrameJacobian frame = frame_jacobian(cal, views_of[f], offsets, spec);
    project_out_pose(frame.J);
    take({static_cast<int>(f), frame.J.middleCols(6, offsets.total), frame.J.col(6 + offsets.total),
          frame.sum});
  }
}

SharedCovariance shared_covariance(const Calibration& cal, const SolveSpec& spec) {
  const Offsets offsets = offsets_of(cal);
  MatX S = MatX::Zero(offsets.total, offsets.total);
  SharedCovariance result;
  double sum = 0;
  int n_frames = 0;
  if (has_clocks(cal)) {
    MovingNormal normal = moving_normal(cal, spec);
    S = std::move(normal.S);
    sum = normal.sum;
    result.n_residuals = normal.n_residuals;
    n_frames = normal.n_frames;
  }
  const auto add = [&](const PoseFreeFrame& frame) {
    S.noalias() += frame.J.transpose() * frame.J;
    sum += frame.sum_sq;
    result.n_residuals += static_cast<int>(frame.J.rows());
    ++n_frames;
  };
  if (!has_clocks(cal)) for_each_pose_free_frame(cal, spec, add);
  const Reduction reduction = reduction_of(spec, offsets.total);
  result.n_free = reduction.n_free + 6 * n_frames;
  const PriorRows priors = prior_rows(cal, spec);
  const PriorScatter scatter = scatter_of(priors, reduction);
  const int n_known = result.n_residuals + scatter.n;
  // Marking outliers takes its share of the corners' residuals only.
  if (n_known > result.n_free)
    result.variance = (sum / spec.variance_kept + scatter.sum) / (n_known - result.n_free);
  result.unit_covariance = MatX::Zero(offsets.total, offsets.total);
  if (reduction.n_free == 0) return result;
  S.noalias() += priors.J.transpose() * priors.J;
  // The step of the shared parameters is E times that of the free numbers.
  MatX E = MatX::Zero(offsets.total, reduction.n_free);
  for (int i = 0; i < offsets.total; ++i) {
    if (reduction.column[i] >= 0) E(i, reduction.column[i]) = 1;
  }
  // Scaled to a unit diagonal, so that radians, metres and pixels compare.
  const MatX S_free = E.transpose() * S * E;
  const VecX scale = S_free.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const SymEigen eigen = sym_eigen(scale.asDiagonal() * S_free * scale.asDiagonal());
  const double least = 1e-14 * eigen.values[eigen.values.size() - 1];
  if (!(eigen.values[0] > least)) result.null_direction = E * eigen.vectors.col(0);
  const MatX scaled = scale.asDiagonal() * eigen.vectors;
  const MatX C = scaled * eigen.values.cwiseMax(least).cwiseInverse().asDiagonal() * scaled.transpose();
  for (int i = 0; i < offsets.total; ++i) {
    for (int j = 0; j < offsets.total; ++j) {
      if (reduction.column[i] >= 0 && reduction.column[j] >= 0)
        result.unit_covariance(i, j) = C(reduction.column[i], reduction.column[j]);
    }
  }
  return result;
}

double residual_variance(const Calibration& cal, const SolveSpec& spec) {
  if (std::none_of(cal.rig.cameras.begin(), cal.rig.cameras.end(),
                   [](const Camera& camera) { return is_sparse(camera.lens); }))
    return shared_covariance(cal, spec).variance;
  const Offsets offsets = offsets_of(cal);
  SolveSpec dense = spec;  // with the control points held
  dense.held.resize(static_cast<std::size_t>(offsets.total), false);
  for (std::size_t cam = 0; cam < cal.rig.cameras.size(); ++cam) {
    const Lens& lens = cal.rig.cameras[cam].lens;
    if (is_sparse(lens)) std::fill_n(dense.held.begin() + offsets.lens[cam], n_params(lens), true);
  }
  const Reduction reduction = reduction_of(dense, offsets.total);
  const PriorScatter scatter = scatter_of(prior_rows(cal, spec), reduction);
  std::vector<bool> seen(cal.T_rig_board.size(), false);
  Calibration now = cal;
  evaluate(now);
  double sum = 0;
  int n = 0;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    if (!takes_part(cal, v)) continue;
    const View& view = cal.data.views[v];
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      if (cal.fits[v][i].outlier) continue;
      const double weight = spec.use_sigma ? 1 / view.corners[i].sigma_px : 1.0;
      sum +=
          rho(spec.loss, spec.loss_scale, weight * weight * now.fits[v][i].residual_px.squaredNorm()).value;
      n += 2;
      seen[static_cast<std::size_t>(view.frame)] = true;
    }
  }
  const auto n_frames = static_cast<int>(std::count(seen.begin(), seen.end(), true));
  const int n_known = n + scatter.n, n_free = reduction.n_free + 6 * n_frames;
  return n_known > n_free ? (sum / spec.variance_kept + scatter.sum) / (n_known - n_free) : 0.0;
}

}  // namespace plumbline::detail
