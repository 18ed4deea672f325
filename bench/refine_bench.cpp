// SPDX-License-Identifier: Apache-2.0
// Time of the joint solve and of the whole calibration, beside cv::calibrateCamera (CALIB_USE_LU) on the same
// corners, all on one thread. The counter of_opencv is our time divided by OpenCV's.
#include <benchmark/benchmark.h>

#include <chrono>
#include <cmath>
#include <map>
#include <opencv2/calib3d.hpp>

#include "plumbline/core/random.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/refine/refine.hpp"

namespace {

using namespace plumbline;

// A board of 14x10 corners, 30 mm apart, seen by one opencv5 lens with 0.3 px noise. The start has no
// distortion, a focal length 5 % too long, and boards off by two degrees and some centimetres.
Calibration make_problem(int n_views) {
  Calibration cal;
  Rng rng(static_cast<std::uint64_t>(n_views));
  cal.data.targets = {*make_target(Chessboard{.columns = 14, .rows = 10, .square_m = 0.03})};
  cal.data.cameras = {{"cam", {1920, 1200}}};
  const std::vector<double> k{1500, 1503, 955, 603, -0.2, 0.08, 0.0005, -0.0003, -0.01};
  cal.rig.cameras = {{"cam", {1920, 1200}, *make_lens("opencv5", k)}};
  cal.rig.T_cam_rig = {SE3()};
  while (static_cast<int>(cal.data.views.size()) < n_views) {
    const Vec3 w(rng.uniform(-0.6, 0.6), rng.uniform(-0.6, 0.6), rng.uniform(-0.3, 0.3));
    const SE3 T(so3_exp(w), Vec3(rng.uniform(-0.35, 0.0), rng.uniform(-0.25, 0.0), rng.uniform(0.5, 0.9)));
    View view{0, static_cast<int>(cal.data.frames.size()), std::to_string(cal.data.frames.size()), {}, ""};
    for (int id = 0; id < 140; ++id) {
      const auto px = project(cal.rig.cameras[0].lens, T * cal.data.targets[0].points[id]);
      if (!px || px->x() < 0 || px->y() < 0 || px->x() > 1919 || px->y() > 1199) break;
      view.corners.push_back({id, *px + Vec2(rng.normal(0.3), rng.normal(0.3)), 1.0});
    }
    if (view.corners.size() < 140) continue;
    cal.data.frames.push_back(view.image);
    cal.data.views.push_back(view);
    cal.T_rig_board.push_back(box_plus(T, (Vec6() << 0.02, -0.02, 0.02, 0.01, -0.01, 0.02).finished()));
  }
  const auto start = params(cal.rig.cameras[0].lens);
  start[0] *= 1.05;
  start[1] *= 1.05;
  for (std::size_t i = 4; i < start.size(); ++i) start[i] = 0;
  return cal;
}

double opencv_seconds(const Dataset& data) {
  std::vector<std::vector<cv::Point3f>> board;
  std::vector<std::vector<cv::Point2f>> px;
  for (const View& view : data.views) {
    board.emplace_back();
    px.emplace_back();
    for (const Corner& c : view.corners) {
      const Vec3& p = data.targets[0].points[c.point];
      board.back().emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()), 0.F);
      px.back().emplace_back(static_cast<float>(c.px.x()), static_cast<float>(c.px.y()));
    }
  }
  cv::setNumThreads(1);
  cv::Mat K, D;
  std::vector<cv::Mat> r, t;
  const auto before = std::chrono::steady_clock::now();
  cv::calibrateCamera(board, px, {1920, 1200}, K, D, r, t, cv::CALIB_USE_LU);
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - before).count();
}

// Measured once for each size.
double opencv_seconds_for(int n_views) {
  static std::map<int, double> known;
  const auto found = known.find(n_views);
  if (found != known.end()) return found->second;
  return known[n_views] = opencv_seconds(make_problem(n_views).data);
}

RefineOptions options_of() {
  RefineOptions options;
  options.mark_outliers = false;
  options.n_threads = 1;
  return options;
}

template <class Body>
void run(benchmark::State& state, Body&& body) {
  const int n_views = static_cast<int>(state.range(0));
  const Calibration problem = make_problem(n_views);
  double seconds = 0;
  for (auto _ : state) {
    const auto before = std::chrono::steady_clock::now();
    const auto cal = body(problem);
    seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - before).count();
    if (!cal)
      state.SkipWithError(cal.error().text().c_str());
    else
      state.counters["rms_xy_px"] = cal->stats.rms_xy_px;
  }
  state.counters["of_opencv"] =
      seconds / static_cast<double>(state.iterations()) / opencv_seconds_for(n_views);
}

void BM_Refine(benchmark::State& state) {
  run(state, [](const Calibration& problem) { return refine(problem, options_of()); });
}
BENCHMARK(BM_Refine)->Arg(20)->Arg(100)->Unit(benchmark::kMillisecond);

void BM_Calibrate(benchmark::State& state) {
  run(state, [](const Calibration& problem) { return calibrate(problem.data, options_of()); });
}
BENCHMARK(BM_Calibrate)->Arg(20)->Arg(100)->Unit(benchmark::kMillisecond);

}  // namespace
