// SPDX-License-Identifier: Apache-2.0
// Time per point of each lens of the list, beside OpenCV and mrcal on the same points. items_per_second is
// points.
#include <benchmark/benchmark.h>
#include <ceres/jet.h>

#include <numbers>
#include <opencv2/calib3d.hpp>
#include <string>
#include <vector>

#include "plumbline/core/random.hpp"
#include "plumbline/lens/lens.hpp"

extern "C" {
#include <mrcal/mrcal.h>
}

namespace plumbline {
namespace {

constexpr int kPoints = 1000;

// Distortion as a real camera has it: parameters that are not named here stay as in the seed.
template <class L>
L real_lens() {
  L lens = L::seed({1280, 960}, 800);
  if constexpr (L::kName == "opencv4") lens.d = {-0.28, 0.03, 1e-3, -1e-4};
  if constexpr (L::kName == "opencv5") lens.d = {-0.28, 0.03, 1e-3, -1e-4, 0.16};
  if constexpr (L::kName == "opencv8") lens.d = {0.52, -2.71, 6e-4, -3e-4, 1.61, 0.40, -2.53, 1.53};
  if constexpr (L::kName == "opencv12") {
    lens.d = {0.52, -2.71, 6e-4, -3e-4, 1.61, 0.40, -2.53, 1.53, 1e-3, -1e-4, 5e-4, 1e-4};
  }
  if constexpr (L::kName == "kb4") lens.k1 = -0.0015, lens.k2 = -0.0033, lens.k3 = 0.0061, lens.k4 = -0.0037;
  return lens;
}

// Points all over a 78 x 62 degree image.
std::vector<Vec3> points() {
  Rng rng(1);
  std::vector<Vec3> p;
  for (int i = 0; i < kPoints; ++i) {
    const double z = rng.uniform(0.5, 3);
    p.emplace_back(z * rng.uniform(-0.8, 0.8), z * rng.uniform(-0.6, 0.6), z);
  }
  return p;
}

// Runs body(point) over the points; the benchmark's time is for all of them.
template <class Body>
void over_points(benchmark::State& state, Body&& body) {
  const auto p = points();
  for (auto _ : state) {
    for (const Vec3& point : p) body(point);
  }
  state.SetItemsProcessed(state.iterations() * kPoints);
  state.counters["ns_per_point"] =
      benchmark::Counter(1e-9 * static_cast<double>(state.iterations()) * kPoints,
                         benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

template <class L>
void project_only(benchmark::State& state) {
  const Lens lens = real_lens<L>();
  over_points(state, [&](const Vec3& p) { benchmark::DoNotOptimize(project(lens, p)); });
}

template <class L>
void project_inlined(benchmark::State& state) {
  L lens = real_lens<L>();
  benchmark::DoNotOptimize(lens);
  over_points(state, [&](const Vec3& p) { benchmark::DoNotOptimize(lens.project(p)); });
}

template <class L>
void project_with_jacobians(benchmark::State& state) {
  L lens = real_lens<L>();
  benchmark::DoNotOptimize(lens);
  Mat23 J_px_p;
  JacParams<L> J_px_k;
  over_points(state, [&](const Vec3& p) {
    benchmark::DoNotOptimize(lens.project(p, &J_px_p, &J_px_k));
    benchmark::DoNotOptimize(J_px_p);
    benchmark::DoNotOptimize(J_px_k);
  });
}

template <class L>
void autodiff_with_jacobians(benchmark::State& state) {
  const L lens = real_lens<L>();
  using Jet = ceres::Jet<double, 3 + L::kNumParams>;
  over_points(state, [&](const Vec3& p_cam) {
    Jet k[L::kNumParams], p[3], px[2];
    for (int i = 0; i < L::kNumParams; ++i) k[i] = Jet((&lens.fx)[i], 3 + i);
    for (int i = 0; i < 3; ++i) p[i] = Jet(p_cam[i], i);
    L::project_t(k, p, px);
    benchmark::DoNotOptimize(px);
  });
}

template <class L>
void unproject_pixels(benchmark::State& state) {
  const Lens lens = real_lens<L>();
  std::vector<Vec3> px;
  for (const Vec3& p : points()) {
    if (const auto q = project(lens, p)) px.emplace_back(q->x(), q->y(), 0);
  }
  for (auto _ : state) {
    for (const Vec3& q : px) benchmark::DoNotOptimize(unproject(lens, q.head<2>()));
  }
  state.counters["ns_per_point"] =
      benchmark::Counter(1e-9 * static_cast<double>(state.iterations()) * static_cast<double>(px.size()),
                         benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

void set_counter(benchmark::State& state) {
  state.counters["ns_per_point"] =
      benchmark::Counter(1e-9 * static_cast<double>(state.iterations()) * kPoints,
                         benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

template <class L>
void opencv(benchmark::State& state, bool with_jacobians) {
  L lens = real_lens<L>();
  const cv::Matx33d K(lens.fx, 0, lens.cx, 0, lens.fy, lens.cy, 0, 0, 1);
  const int n = L::kNumParams - 4;
  const cv::Mat d = n == 0 ? cv::Mat() : cv::Mat(n, 1, CV_64F, &lens.fx + 4);
  std::vector<cv::Point3d> p;
  for (const Vec3& q : points()) p.emplace_back(q.x(), q.y(), q.z());
  std::vector<cv::Point2d> px;
  cv::Mat J;
  const cv::Vec3d zero(0, 0, 0);
  for (auto _ : state) {
    if constexpr (L::kName == "kb4") {
      with_jacobians ? cv::fisheye::projectPoints(p, px, zero, zero, K, d, 0, J)
                     : cv::fisheye::projectPoints(p, px, zero, zero, K, d);
    } else {
      with_jacobians ? cv::projectPoints(p, zero, zero, K, d, px, J)
                     : cv::projectPoints(p, zero, zero, K, d, px);
    }
    benchmark::DoNotOptimize(px.data());
  }
  set_counter(state);
}

template <class L>
void mrcal(benchmark::State& state, const char* name, bool with_jacobians) {
  const L lens = real_lens<L>();
  mrcal_lensmodel_t model;
  mrcal_lensmodel_from_name(&model, name);
  std::vector<mrcal_point3_t> p;
  for (const Vec3& q : points()) p.push_back({.xyz = {q.x(), q.y(), q.z()}});
  std::vector<mrcal_point2_t> px(kPoints);
  std::vector<mrcal_point3_t> J_p(2 * kPoints);
  std::vector<double> J_k(2 * L::kNumParams * kPoints);
  for (auto _ : state) {
    mrcal_project(px.data(), with_jacobians ? J_p.data() : nullptr, with_jacobians ? J_k.data() : nullptr,
                  p.data(), kPoints, &model, &lens.fx);
    benchmark::DoNotOptimize(px.data());
  }
  set_counter(state);
}

constexpr const char* mrcal_name(std::string_view name) {
  if (name == "pinhole") return "LENSMODEL_PINHOLE";
  if (name == "opencv4") return "LENSMODEL_OPENCV4";
  if (name == "opencv5") return "LENSMODEL_OPENCV5";
  if (name == "opencv8") return "LENSMODEL_OPENCV8";
  if (name == "opencv12") return "LENSMODEL_OPENCV12";
  return nullptr;
}

template <FixedLens L>
void register_lens() {
  const std::string name(L::kName);
  const auto add = [&](const std::string& what, auto function) {
    benchmark::RegisterBenchmark((name + "/" + what).c_str(), function);
  };
  add("project", project_only<L>);
  add("project_inlined", project_inlined<L>);
  add("project_with_jacobians", project_with_jacobians<L>);
  add("autodiff_with_jacobians", autodiff_with_jacobians<L>);
  add("unproject", unproject_pixels<L>);
  if (L::kName == "kb4" || mrcal_name(L::kName)) {
    add("opencv_project", [](benchmark::State& s) { opencv<L>(s, false); });
    add("opencv_with_jacobians", [](benchmark::State& s) { opencv<L>(s, true); });
  }
  if (mrcal_name(L::kName)) {
    add("mrcal_project", [](benchmark::State& s) { mrcal<L>(s, mrcal_name(L::kName), false); });
    add("mrcal_with_jacobians", [](benchmark::State& s) { mrcal<L>(s, mrcal_name(L::kName), true); });
  }
}

template <class... L>
bool register_all(std::variant<L...>*) {
  cv::setNumThreads(1);
  const auto add = []<class Any>(const Any*) {
    if constexpr (FixedLens<Any>) register_lens<Any>();
  };
  (add(static_cast<const L*>(nullptr)), ...);
  return true;
}
const bool kRegistered = register_all(static_cast<Lens*>(nullptr));

}  // namespace
}  // namespace plumbline
