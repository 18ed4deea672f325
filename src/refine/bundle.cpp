// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/bundle.hpp"

#include <ceres/cost_function.h>
#include <ceres/loss_function.h>
#include <ceres/manifold.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "refine/bundle_setup.hpp"
#include "refine/quiet_log.hpp"
#include "refine/reprojection_cost.hpp"

namespace plumbline {
namespace {

using namespace detail;

constexpr int kRounds = 5;  // of solving and trying those again that did not project
// Reduced parameters. Measured with each point in ten neighbouring views, which favours the sparse solver:
// the two are equal at 700. Where all views share points the dense one is always the faster.
constexpr int kMostDense = 900, kMostSparse = 30'000;
constexpr int kMostJudged = 1500;  // a dense factor of that size costs less than an iteration does

// All parameter blocks in one array, in a fixed order: Ceres orders the blocks of an elimination group by
// address, and the order decides how sums round.
class Blocks {
 public:
  explicit Blocks(const Reconstruction& scene) {
    for (const Camera& camera : scene.cameras) {
      lens_.push_back(values_.size());
      const auto k = params(camera.lens);
      values_.insert(values_.end(), k.begin(), k.end());
    }
    views_ = values_.size();
    for (const ReconstructionView& view : scene.views)
      values_.insert(values_.end(), view.T_cam_world.qt.begin(), view.T_cam_world.qt.end());
    points_ = values_.size();
    for (const Vec3& p : scene.p_world) values_.insert(values_.end(), p.data(), p.data() + 3);
  }
  double* lens(int camera) { return &values_[lens_[camera]]; }
  double* view(int v) { return &values_[views_ + 7 * static_cast<std::size_t>(v)]; }
  double* point(int p) { return &values_[points_ + 3 * static_cast<std::size_t>(p)]; }

  // Blocks that took no part are written back as they came.
  void write_to(Reconstruction& scene) const {
    for (std::size_t c = 0; c < lens_.size(); ++c) {
      const auto k = params(scene.cameras[c].lens);
      std::copy_n(&values_[lens_[c]], k.size(), k.begin());
    }
    for (std::size_t v = 0; v < scene.views.size(); ++v)
      std::copy_n(values_.begin() + static_cast<std::ptrdiff_t>(views_ + 7 * v), 7,
                  scene.views[v].T_cam_world.qt.begin());
    for (std::size_t p = 0; p < scene.p_world.size(); ++p)
      std::copy_n(values_.begin() + static_cast<std::ptrdiff_t>(points_ + 3 * p), 3, scene.p_world[p].data());
  }

 private:
  std::vector<double> values_;
  std::vector<std::size_t> lens_;
  std::size_t views_ = 0, points_ = 0;
};

std::unique_ptr<ceres::LossFunction> make_loss(const BundleOptions& options) {
  if (options.loss == Loss::kHuber) return std::make_unique<ceres::HuberLoss>(options.loss_scale);
  if (options.loss == Loss::kCauchy) return std::make_unique<ceres::CauchyLoss>(options.loss_scale);
  return nullptr;
}

// Manifolds and losses are shared by all blocks, so that the problem does not own them.
struct Shared {
  std::unique_ptr<ceres::LossFunction> loss;
  std::unique_ptr<ceres::Manifold> pose = make_pose_manifold(), sphere;
  std::vector<std::unique_ptr<ceres::Manifold>> lens;
};

ceres::Problem::Options problem_options() {
  ceres::Problem::Options options;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return options;
}

void add_residuals(ceres::Problem& problem, Blocks& blocks, const Reconstruction& scene,
                   const BundleSetup& setup, const Participation& part, const Shared& shared) {
  for (std::size_t i = 0; i < scene.sightings.size(); ++i) {
    if (!part.sighting[i]) continue;
    const Sighting& s = scene.sightings[i];
    const int camera = scene.views[s.view].camera;
    problem.AddResidualBlock(make_sighting_cost(scene.cameras[camera].lens, s.px, s.sigma_px).release(),
                             shared.loss.get(), blocks.lens(camera), blocks.view(s.view),
                             blocks.point(s.point));
  }
  for (const ScaleBar& bar : setup.bars) {
    problem.AddResidualBlock(make_scale_bar_cost(bar.length_m, bar.sigma_m).release(), nullptr,
                             blocks.point(bar.point_a), blocks.point(bar.point_b));
  }
}

// Which blocks move and how, and which are eliminated first: the points, or the views where no point moves.
void set_steps(ceres::Problem& problem, Blocks& blocks, const Reconstruction& scene, const BundleSetup& setup,
               Shared& shared, ceres::ParameterBlockOrdering& ordering) {
  bool points_move = false;
  for (std::size_t p = 0; p < scene.p_world.size(); ++p) {
    double* block = blocks.point(static_cast<int>(p));
    if (!problem.HasParameterBlock(block)) continue;
    if (setup.point_held[p]) {
      problem.SetParameterBlockConstant(block);
      continue;
    }
    ordering.AddElementToGroup(block, setup.point_shared[p] ? 1 : 0);
    points_move = true;
  }
  for (std::size_t v = 0; v < scene.views.size(); ++v) {
    double* block = blocks.view(static_cast<int>(v));
    if (!problem.HasParameterBlock(block)) continue;
    if (setup.view_held[v]) {
      problem.SetParameterBlockConstant(block);
      continue;
    }
    const bool on_sphere = static_cast<int>(v) == setup.sphere_view;
    problem.SetManifold(block, on_sphere ? shared.sphere.get() : shared.pose.get());
    ordering.AddElementToGroup(block, points_move ? 1 : 0);
  }
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    double* block = blocks.lens(static_cast<int>(c));
    const MatX& step = setup.lens_step[c];
    if (!problem.HasParameterBlock(block)) continue;
    if (step.cols() == 0) {
      problem.SetParameterBlockConstant(block);
      continue;
    }
    if (step.cols() < step.rows()) {
      shared.lens.push_back(make_linear_manifold(step));
      problem.SetManifold(block, shared.lens.back().get());
    }
    ordering.AddElementToGroup(block, 1);
  }
}

ceres::LinearSolverType linear_solver(BundleSolver solver, int n_shared) {
  if (solver == BundleSolver::kAuto) {
    solver = n_shared <= kMostDense    ? BundleSolver::kDenseSchur
             : n_shared <= kMostSparse ? BundleSolver::kSparseSchur
                                       : BundleSolver::kIterativeSchur;
  }
  if (solver == BundleSolver::kDenseSchur) return ceres::DENSE_SCHUR;
  return solver == BundleSolver::kSparseSchur ? ceres::SPARSE_SCHUR : ceres::ITERATIVE_SCHUR;
}

ceres::Solver::Options solver_options(const BundleOptions& options, int n_shared) {
  ceres::Solver::Options o;
  o.max_num_iterations = options.max_iterations;
  o.function_tolerance = 1e-13;
  o.parameter_tolerance = 1e-12;
  o.gradient_tolerance = 1e-12;
  o.num_threads = 1;  // more would add in another order and give other bytes
  o.linear_solver_type = linear_solver(options.solver, n_shared);
  if (o.linear_solver_type == ceres::ITERATIVE_SCHUR) o.preconditioner_type = ceres::SCHUR_JACOBI;
  o.max_num_consecutive_invalid_steps = 30;  // steps out of a lens' domain are invalid, and shrink the region
  o.logging_type = ceres::SILENT;
  o.minimizer_progress_to_stdout = false;
  return o;
}

bool sound(const Reconstruction& scene) { return validate(scene).has_value(); }

double rms_px(const Reconstruction& scene, const Participation& part) {
  double sum = 0;
  for (std::size_t i = 0; i < scene.sightings.size(); ++i) {
    if (!part.sighting[i]) continue;
    if (const auto px = predict(scene, scene.sightings[i]))
      sum += (*px - scene.sightings[i].px).squaredNorm();
  }
  return part.n_sightings > 0 ? std::sqrt(sum / part.n_sightings) : 0;
}

// One solve, in place.
Status solve(Bundle& bundle, const BundleSetup& setup, const Participation& part,
             const BundleOptions& options) {
  Blocks blocks(bundle.scene);
  Shared shared;
  shared.loss = make_loss(options);
  if (setup.sphere) shared.sphere = make_sphere_manifold(*setup.sphere);
  ceres::Problem problem(problem_options());
  add_residuals(problem, blocks, bundle.scene, setup, part, shared);
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  set_steps(problem, blocks, bundle.scene, setup, shared, *ordering);
  ceres::Solver::Options o = solver_options(options, shared_columns(bundle.scene, setup, part).total);
  o.linear_solver_ordering = ordering;
  ceres::Solver::Summary summary;
  const QuietLog quiet;
  bundle.rms_px_before = rms_px(bundle.scene, part);
  ceres::Solve(o, &problem, &summary);
  bundle.cost_before = summary.initial_cost;
  bundle.cost = summary.final_cost;
  bundle.iterations += std::max(0, static_cast<int>(summary.iterations.size()) - 1);
  bundle.converged = summary.termination_type == ceres::CONVERGENCE;
  bundle.termination = summary.message;
  std::replace(bundle.termination.begin(), bundle.termination.end(), '\n', ' ');
  blocks.write_to(bundle.scene);
  if (summary.IsSolutionUsable() && sound(bundle.scene)) return {};
  return Error{ErrorCode::kNotConverged, "no finite optimum was found: " + bundle.termination, "bundle"};
}

Error nothing_left(const Participation& part, const Reconstruction& scene) {
  std::string reason = "it has no sighting that projects";
  if (!part.left_out.empty()) {
    const LeftOut& first = part.left_out.back();
    reason = (first.what == LeftOut::What::kView ? view_name(scene, first.index)
                                                 : point_name(scene, first.index)) +
             " is left out: " + first.reason;
  }
  return {ErrorCode::kDegenerate,
          "no sighting can be used; every point needs 2 views and every view 3 such points (" + reason + ")",
          "bundle"};
}

void fill_results(Bundle& bundle, const BundleSetup& setup, const Participation& part) {
  const Reconstruction& scene = bundle.scene;
  bundle.left_out = part.left_out;
  bundle.gauge = setup.gauge;
  bundle.n_used = part.n_sightings;
  bundle.fits.resize(scene.sightings.size());
  for (std::size_t i = 0; i < scene.sightings.size(); ++i) {
    const auto px = predict(scene, scene.sightings[i]);
    bundle.fits[i].use = part.sighting[i] ? SightingFit::Use::kUsed
                         : px             ? SightingFit::Use::kLeftOut
                                          : SightingFit::Use::kNoProjection;
    if (px) bundle.fits[i].residual_px = *px - scene.sightings[i].px;
  }
  bundle.rms_px = rms_px(scene, part);
  for (const ScaleBar& bar : setup.bars) {
    const double length = (scene.p_world[bar.point_a] - scene.p_world[bar.point_b]).norm();
    bundle.bar_residual_m.push_back(length - bar.length_m);
  }
  bundle.n_free_parameters = count_free(shared_columns(scene, setup, part), setup, part);
  const int n_residuals = 2 * part.n_sightings + static_cast<int>(setup.bars.size());
  if (n_residuals > bundle.n_free_parameters)
    bundle.variance_factor = 2 * bundle.cost / (n_residuals - bundle.n_free_parameters);
}

}  // namespace

Result<Bundle> adjust_bundle(const Reconstruction& start, const BundleOptions& options) {
  if (Status valid = validate(start); !valid) return valid.error();
  auto setup = make_setup(start, options);
  if (!setup) return setup.error();
  Bundle bundle;
  bundle.scene = start;
  Participation part = participation_of(start, *setup);
  if (part.n_sightings == 0) return nothing_left(part, start);
  if (Status fixed = fix_gauge(*setup, bundle.scene, part, options); !fixed) return fixed.error();
  for (int round = 0; round < kRounds; ++round) {
    if (Status solved = solve(bundle, *setup, part, options); !solved) return solved.error();
    Participation next = participation_of(bundle.scene, *setup);
    if (next == part || round + 1 == kRounds) break;
    if (next.n_sightings == 0) return nothing_left(next, bundle.scene);
    if (Status fixed = check_gauge(*setup, bundle.scene, next); !fixed) return fixed.error();
    part = std::move(next);
  }
  fill_results(bundle, *setup, part);
  if (Status known = bundle_covariance(bundle, *setup, part, options,
                                       options.solver == BundleSolver::kIterativeSchur ? 0 : kMostJudged);
      !known)
    return known.error();
  return bundle;
}

}  // namespace plumbline
