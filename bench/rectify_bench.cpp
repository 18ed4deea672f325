// SPDX-License-Identifier: Apache-2.0
#include <benchmark/benchmark.h>
#include <malloc.h>

#include <opencv2/calib3d.hpp>
#include <opencv2/core/utility.hpp>

#include "plumbline/geometry/so3.hpp"
#include "plumbline/rectify/remap.hpp"

// Rectification maps of ours against OpenCV's for the same camera, one thread each; items are pixels.
namespace {

template <class M>
cv::Mat to_cv(const M& m) {
  cv::Mat out(static_cast<int>(m.rows()), static_cast<int>(m.cols()), CV_64F);
  for (int r = 0; r < out.rows; ++r) {
    for (int c = 0; c < out.cols; ++c) out.at<double>(r, c) = m(r, c);
  }
  return out;
}

using namespace plumbline;

const ImageSize kSize{1920, 1200};
const Mat3 kTurned = so3_exp(Vec3(0.02, -0.03, 0.01));
const Mat3 kNew = (Mat3() << 1100, 0, 955, 0, 1100, 598, 0, 0, 1).finished();

Camera opencv5() { return {"c", kSize, OpenCV5{1200, 1201, 960, 600, {-0.28, 0.08, 0.001, -0.0005, 0.02}}}; }
Camera kb4() { return {"c", kSize, KannalaBrandt4{700, 701, 960, 600, -0.01, 0.002, -0.0005, 0}}; }

// Without this whoever runs first pays for fresh pages in each iteration, and the others do not.
void keep_memory() {
  mallopt(M_MMAP_THRESHOLD, 1 << 30);
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
}

void ours(benchmark::State& state, const Camera& camera) {
  keep_memory();
  for (auto _ : state) {
    const RemapMaps maps = remap_maps(camera, kTurned, kNew, kSize, 1);
    benchmark::DoNotOptimize(maps.x.data);
  }
  state.SetItemsProcessed(state.iterations() * kSize.width * kSize.height);
}

void opencv(benchmark::State& state, const Camera& camera, bool fisheye) {
  keep_memory();
  cv::setNumThreads(1);
  const auto k = params(camera.lens);
  cv::Mat K, R, N, x, y, D(1, static_cast<int>(k.size()) - 4, CV_64F, const_cast<double*>(k.data() + 4));
  K = to_cv(camera_matrix_k(camera.lens));
  R = to_cv(kTurned);
  N = to_cv(kNew);
  for (auto _ : state) {
    x.release(), y.release();  // fresh matrices for both sides
    if (fisheye)
      cv::fisheye::initUndistortRectifyMap(K, D, R, N, {kSize.width, kSize.height}, CV_32FC1, x, y);
    else
      cv::initUndistortRectifyMap(K, D, R, N, {kSize.width, kSize.height}, CV_32FC1, x, y);
    benchmark::DoNotOptimize(x.data);
  }
  state.SetItemsProcessed(state.iterations() * kSize.width * kSize.height);
}

BENCHMARK_CAPTURE(opencv, opencv5, opencv5(), false);
BENCHMARK_CAPTURE(ours, opencv5, opencv5());
BENCHMARK_CAPTURE(opencv, kb4, kb4(), true);
BENCHMARK_CAPTURE(ours, kb4, kb4());

}  // namespace

BENCHMARK_MAIN();
