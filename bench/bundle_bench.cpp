// SPDX-License-Identifier: Apache-2.0
// adjust_bundle() beside what one would write with Ceres alone: a cost with automatic differentiation for
// each sighting, rotation vectors, SPARSE_SCHUR, one thread, the same stopping rule, the same views held. The
// counter of_plain is our time divided by the plain one's, per iteration and in all.
#include <benchmark/benchmark.h>
#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <ctime>
#include <map>

#include "plumbline/core/random.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/refine/bundle.hpp"

namespace {

using namespace plumbline;

struct PlainCost {
  Vec2 px;
  template <class T>
  bool operator()(const T* k, const T* pose, const T* point, T* residual) const {
    T p_cam[3], projected[2];
    ceres::AngleAxisRotatePoint(pose, point, p_cam);
    for (int i = 0; i < 3; ++i) p_cam[i] += pose[3 + i];
    OpenCV5::project_t(k, p_cam, projected);
    residual[0] = projected[0] - px.x();
    residual[1] = projected[1] - px.y();
    return true;
  }
};

// Views on an arc about a cloud of points, each point seen by ten views next to one another; 0.5 px of noise,
// and a start off by some pixels.
Reconstruction make_scene(int n_views, int n_points) {
  Rng rng(1);
  Reconstruction scene;
  const std::vector<double> k{900, 902, 640, 480, -0.2, 0.08, 0.0005, -0.0003, -0.01};
  scene.cameras = {{"camera1", {1280, 960}, *make_lens("opencv5", k)}};
  for (int v = 0; v < n_views; ++v) {
    const double around = 2.4 * v / n_views - 1.2;
    const Mat3 R =
        so3_exp(Vec3(rng.uniform(-0.2, 0.2), 0, rng.uniform(-0.2, 0.2))) * so3_exp(Vec3(0, around, 0));
    scene.views.push_back({0, "", SE3(R, Vec3(rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 6)), -1});
  }
  for (int p = 0; p < n_points; ++p) {
    scene.p_world.emplace_back(rng.uniform(-1.5, 1.5), rng.uniform(-1.5, 1.5), rng.uniform(-1.5, 1.5));
    const int first = rng.index(n_views - 9);
    for (int v = first; v < first + 10; ++v) {
      const auto px = predict(scene, {v, p, Vec2::Zero(), 1});
      if (px) scene.sightings.push_back({v, p, *px + Vec2(rng.normal(0.5), rng.normal(0.5)), 1});
    }
  }
  for (int v = 0; v < n_views; ++v) {
    if (v == 0 || v == n_views - 1) continue;
    Vec6 d;
    for (double& x : d) x = rng.normal(0.01);
    scene.views[v].T_cam_world = box_plus(scene.views[v].T_cam_world, d);
  }
  for (Vec3& p : scene.p_world) p += Vec3(rng.normal(0.02), rng.normal(0.02), rng.normal(0.02));
  return scene;
}

struct Timing {
  double seconds = 0, cost = 0;
  int iterations = 0;
};

double seconds_since(std::clock_t start) {
  return static_cast<double>(std::clock() - start) /
         CLOCKS_PER_SEC;  // of this process: other load does not count
}

Timing plain(Reconstruction scene, bool lens_free) {
  const std::clock_t start = std::clock();
  std::vector<std::array<double, 6>> poses;
  for (const ReconstructionView& view : scene.views) {
    const Vec3 w = so3_log(view.T_cam_world.R()), t = view.T_cam_world.t();
    poses.push_back({w.x(), w.y(), w.z(), t.x(), t.y(), t.z()});
  }
  double* lens = params(scene.cameras[0].lens).data();
  ceres::Problem problem;
  for (const Sighting& s : scene.sightings)
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<PlainCost, 2, 9, 6, 3>(new PlainCost{s.px}),
                             nullptr, lens, poses[s.view].data(), scene.p_world[s.point].data());
  problem.SetParameterBlockConstant(poses.front().data());
  problem.SetParameterBlockConstant(poses.back().data());
  if (!lens_free) problem.SetParameterBlockConstant(lens);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_SCHUR;
  options.function_tolerance = 1e-13;
  options.parameter_tolerance = options.gradient_tolerance = 1e-12;
  options.max_num_iterations = 200;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return {seconds_since(start), summary.final_cost, static_cast<int>(summary.iterations.size()) - 1};
}

Timing ours(const Reconstruction& scene, bool lens_free) {
  const std::clock_t start = std::clock();
  BundleOptions options{.hold_views = {0, static_cast<int>(scene.views.size()) - 1}};
  if (lens_free) options.free_intrinsics = {"all"};
  const auto bundle = adjust_bundle(scene, options);
  return {seconds_since(start), bundle.value().cost, bundle->iterations};
}

void bundle(benchmark::State& state) {
  const Reconstruction scene = make_scene(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)));
  const bool lens_free = state.range(2) != 0;
  Timing a, b;
  for (auto _ : state) {
    b = plain(scene, lens_free);
    a = ours(scene, lens_free);
    state.SetIterationTime(a.seconds);
  }
  state.counters["of_plain"] = a.seconds / b.seconds;
  state.counters["of_plain_per_iteration"] = a.seconds / a.iterations / (b.seconds / b.iterations);
  state.counters["iterations"] = a.iterations;
  state.counters["plain_iterations"] = b.iterations;
  state.counters["cost_over_plain"] = a.cost / b.cost - 1;
  state.counters["sightings"] = static_cast<double>(scene.sightings.size());
}
BENCHMARK(bundle)
    ->ArgNames({"views", "points", "lens_free"})
    ->Args({20, 200, 0})
    ->Args({50, 5000, 0})
    ->Args({50, 5000, 1})
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
