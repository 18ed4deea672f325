// SPDX-License-Identifier: Apache-2.0
// Time and accuracy of the estimators of one and two views beside OpenCV's and mrcal's, on the same seeded
// problems. bench/geometry/run makes the table of docs/accuracy.md out of it. A benchmark is named
// GROUP/METHOD; its time is that of one problem, and its counters are the root mean square and the median
// error over the problems, and the share of problems without an answer or with one so wrong that it is no
// noise ("failed"; left out of the RMS).
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "geometry/geometry.hpp"

namespace {

using plumbline::bench::Method;

void run(benchmark::State& state, const Method& method) {
  const std::size_t n = method.n_problems;
  std::size_t i = 0;
  for (auto _ : state) {
    method.solve(i);
    i = i + 1 < n ? i + 1 : 0;
  }
  std::vector<double> errors;
  double sum = 0;
  for (std::size_t k = 0; k < n; ++k) {
    const std::optional<double> e = method.error(k);
    if (!e || !(*e <= method.failure)) continue;
    errors.push_back(*e);
    sum += *e * *e;
  }
  std::sort(errors.begin(), errors.end());
  if (!errors.empty()) {
    state.counters["rms"] = std::sqrt(sum / static_cast<double>(errors.size()));
    state.counters["median"] = errors[errors.size() / 2];
  }
  state.counters["failed"] = 1 - static_cast<double>(errors.size()) / static_cast<double>(n);
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<Method> methods;
  plumbline::bench::add_plane_methods(methods);
  plumbline::bench::add_two_view_methods(methods);
  plumbline::bench::add_pose_methods(methods);
  plumbline::bench::add_point_methods(methods);
  for (const Method& method : methods) {
    benchmark::RegisterBenchmark((method.group + "/" + method.name).c_str(), [&method](
                                                                                 benchmark::State& state) {
      run(state, method);
    })->Unit(benchmark::kMicrosecond);
  }
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
}
