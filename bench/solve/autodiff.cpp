// SPDX-License-Identifier: Apache-2.0
// What one would write with Ceres alone: a cost with automatic differentiation for each corner, rotation
// vectors, DENSE_SCHUR, one thread. Stopped by Ceres' default rule, or tightly.
#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include "plumbline/geometry/so3.hpp"
#include "solve/tools.hpp"

namespace bench {
namespace {

using namespace plumbline;

template <class L>
struct CornerCost {
  Vec3 p_board;
  Vec2 px;
  template <class T>
  bool operator()(const T* k, const T* cam, const T* board, T* residual) const {
    const T p[3] = {T(p_board.x()), T(p_board.y()), T(p_board.z())};
    T p_rig[3], p_cam[3], projected[2];
    ceres::AngleAxisRotatePoint(board, p, p_rig);
    for (int i = 0; i < 3; ++i) p_rig[i] += board[3 + i];
    ceres::AngleAxisRotatePoint(cam, p_rig, p_cam);
    for (int i = 0; i < 3; ++i) p_cam[i] += cam[3 + i];
    return finish(k, p_cam, projected, residual);
  }
  template <class T>
  bool operator()(const T* k, const T* board, T* residual) const {
    const T p[3] = {T(p_board.x()), T(p_board.y()), T(p_board.z())};
    T p_cam[3], projected[2];
    ceres::AngleAxisRotatePoint(board, p, p_cam);
    for (int i = 0; i < 3; ++i) p_cam[i] += board[3 + i];
    return finish(k, p_cam, projected, residual);
  }
  template <class T>
  bool finish(const T* k, const T* p_cam, T* projected, T* residual) const {
    L::project_t(k, p_cam, projected);
    residual[0] = projected[0] - px.x();
    residual[1] = projected[1] - px.y();
    return true;
  }
};

std::array<double, 6> vector_of(const SE3& T) {
  const Vec3 w = so3_log(T.R()), t = T.t();
  return {w.x(), w.y(), w.z(), t.x(), t.y(), t.z()};
}

template <class L>
std::optional<Outcome> solve(SolveSet& set, bool tight) {
  Outcome outcome;
  Calibration& cal = set.start;
  const Stopwatch watch;
  std::vector<std::array<double, 6>> cams, boards;
  for (const SE3& T : cal.rig.T_cam_rig) cams.push_back(vector_of(T));
  for (const auto& T : cal.T_rig_board) boards.push_back(vector_of(*T));
  ceres::Problem problem;
  auto* ordering = new ceres::ParameterBlockOrdering;
  for (const View& view : cal.data.views) {
    double* k = params(cal.rig.cameras[view.cam].lens).data();
    for (const Corner& c : view.corners) {
      auto* cost = new CornerCost<L>{cal.data.targets[0].points[c.point], c.px};
      if (view.cam == 0)
        problem.AddResidualBlock(new ceres::AutoDiffCostFunction<CornerCost<L>, 2, L::kNumParams, 6>(cost),
                                 nullptr, k, boards[view.frame].data());
      else
        problem.AddResidualBlock(new ceres::AutoDiffCostFunction<CornerCost<L>, 2, L::kNumParams, 6, 6>(cost),
                                 nullptr, k, cams[view.cam].data(), boards[view.frame].data());
    }
    ordering->AddElementToGroup(boards[view.frame].data(), 0);
    ordering->AddElementToGroup(k, 1);
    if (view.cam > 0) ordering->AddElementToGroup(cams[view.cam].data(), 1);
  }
  ceres::Solver::Options options;
  options.linear_solver_ordering.reset(ordering);
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.num_threads = 1;
  options.max_num_iterations = 500;
  options.logging_type = ceres::SILENT;
  if (tight) {
    options.function_tolerance = 1e-14;
    options.parameter_tolerance = 1e-12;
    options.gradient_tolerance = 1e-14;
  }
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  watch.stop(outcome);
  if (!summary.IsSolutionUsable()) return std::nullopt;
  outcome.rms_xy_px = std::sqrt(2 * summary.final_cost / summary.num_residuals);
  outcome.iterations = static_cast<int>(summary.iterations.size()) - 1;
  outcome.rig = cal.rig;
  return outcome;
}

}  // namespace

std::optional<Outcome> run_autodiff(SolveSet& set, bool tight) {
  return std::visit(
      [&]<class L>(const L&) -> std::optional<Outcome> {
        if constexpr (FixedLens<L>)
          return solve<L>(set, tight);
        else
          return std::nullopt;
      },
      set.truth.cameras[0].lens);
}

}  // namespace bench
