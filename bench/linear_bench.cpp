// SPDX-License-Identifier: Apache-2.0
// Time of the linear estimators beside OpenCV's, on the same points: a 9x6 board (54 corners) or 54 points in
// space.
#include <benchmark/benchmark.h>

#include <opencv2/calib3d.hpp>
#include <vector>

#include "plumbline/core/random.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/lens/lens.hpp"
#include "plumbline/linear/camera_matrix.hpp"
#include "plumbline/linear/homography.hpp"
#include "plumbline/linear/pose.hpp"
#include "plumbline/linear/zhang.hpp"

namespace {

using namespace plumbline;

const OpenCV5 kLens{520, 530, 315, 243, -0.28, 0.1, 1e-3, -5e-4, -0.01};
const cv::Matx33d kK(520, 0, 315, 0, 530, 243, 0, 0, 1);
const std::vector<double> kDistortion{-0.28, 0.1, 1e-3, -5e-4, -0.01};

struct Sample {
  std::vector<Vec3> p;
  std::vector<Vec2> a, px;
  std::vector<cv::Point3d> cv_p;
  std::vector<cv::Point2d> cv_a, cv_px;
};

// 54 corners of a board (or points in a box), seen with 0.2 px of noise.
Sample make_sample(bool solid, const Lens& lens, std::uint64_t seed) {
  Rng rng(seed);
  const SE3 T(so3_exp(Vec3(0.4 * rng.normal(), 0.4 * rng.normal(), rng.normal())), Vec3(0.02, -0.01, 0.7));
  Sample s;
  for (int i = 0; i < 54; ++i) {
    const Vec3 p(0.03 * (i % 9 - 4), 0.03 * (i / 9 - 2.5), solid ? rng.uniform(-0.1, 0.1) : 0.0);
    const double dx = rng.normal(0.2), dy = rng.normal(0.2);
    const Vec2 px = project(lens, T * p).value() + Vec2(dx, dy);
    s.p.push_back(p);
    s.a.push_back(p.head<2>());
    s.px.push_back(px);
    s.cv_p.emplace_back(p.x(), p.y(), p.z());
    s.cv_a.emplace_back(p.x(), p.y());
    s.cv_px.emplace_back(px.x(), px.y());
  }
  return s;
}

void homography_plumbline(benchmark::State& state) {
  const Sample s = make_sample(false, Pinhole{520, 530, 315, 243}, 1);
  for (auto _ : state) benchmark::DoNotOptimize(homography(s.a, s.px));
}
BENCHMARK(homography_plumbline);

void homography_opencv(benchmark::State& state) {
  const Sample s = make_sample(false, Pinhole{520, 530, 315, 243}, 1);
  for (auto _ : state) benchmark::DoNotOptimize(cv::findHomography(s.cv_a, s.cv_px, 0));
}
BENCHMARK(homography_opencv);

std::vector<Mat3> homographies(int n) {
  std::vector<Mat3> H;
  for (int i = 0; i < n; ++i) {
    const Sample s = make_sample(false, Pinhole{520, 530, 315, 243}, 10 + static_cast<std::uint64_t>(i));
    H.push_back(homography(s.a, s.px).value());
  }
  return H;
}

void zhang_k_plumbline(benchmark::State& state) {
  const std::vector<Mat3> H = homographies(13);
  for (auto _ : state) benchmark::DoNotOptimize(zhang_k(H, {640, 480}));
}
BENCHMARK(zhang_k_plumbline);

void intrinsics_from_corners_plumbline(benchmark::State& state) {
  for (auto _ : state) {
    state.PauseTiming();
    std::vector<Sample> views;
    for (std::uint64_t i = 0; i < 13; ++i)
      views.push_back(make_sample(false, Pinhole{520, 530, 315, 243}, 10 + i));
    state.ResumeTiming();
    std::vector<Mat3> H;
    for (const Sample& s : views) H.push_back(homography(s.a, s.px).value());
    benchmark::DoNotOptimize(zhang_k(H, {640, 480}));
  }
}
BENCHMARK(intrinsics_from_corners_plumbline);

void intrinsics_from_corners_opencv(benchmark::State& state) {
  std::vector<std::vector<cv::Point3f>> object;
  std::vector<std::vector<cv::Point2f>> image;
  for (std::uint64_t i = 0; i < 13; ++i) {
    const Sample s = make_sample(false, Pinhole{520, 530, 315, 243}, 10 + i);
    object.emplace_back(s.cv_p.begin(), s.cv_p.end());
    image.emplace_back(s.cv_px.begin(), s.cv_px.end());
  }
  for (auto _ : state) benchmark::DoNotOptimize(cv::initCameraMatrix2D(object, image, {640, 480}, 0));
}
BENCHMARK(intrinsics_from_corners_opencv);

void camera_matrix_plumbline(benchmark::State& state) {
  const Sample s = make_sample(true, Pinhole{520, 530, 315, 243}, 1);
  for (auto _ : state) benchmark::DoNotOptimize(camera_matrix(s.p, s.px));
}
BENCHMARK(camera_matrix_plumbline);

void decompose_plumbline(benchmark::State& state) {
  const Sample s = make_sample(true, Pinhole{520, 530, 315, 243}, 1);
  const Mat34 P = camera_matrix(s.p, s.px).value();
  for (auto _ : state) benchmark::DoNotOptimize(decompose_camera_matrix(P));
}
BENCHMARK(decompose_plumbline);

void decompose_opencv(benchmark::State& state) {
  const Sample s = make_sample(true, Pinhole{520, 530, 315, 243}, 1);
  const Mat34 P = camera_matrix(s.p, s.px).value();
  cv::Mat P_cv(3, 4, CV_64F), K, R, C;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 4; ++c) P_cv.at<double>(r, c) = P(r, c);
  }
  for (auto _ : state) {
    cv::decomposeProjectionMatrix(P_cv, K, R, C);
    benchmark::DoNotOptimize(K.data);
  }
}
BENCHMARK(decompose_opencv);

void pose(benchmark::State& state, bool solid, bool opencv) {
  const Lens lens = kLens;
  const Sample s = make_sample(solid, lens, 1);
  cv::Mat r, t;
  for (auto _ : state) {
    if (opencv) {
      cv::solvePnP(s.cv_p, s.cv_px, kK, kDistortion, r, t);
      benchmark::DoNotOptimize(t.data);
    } else {
      benchmark::DoNotOptimize(pose_from_points(lens, s.p, s.px));
    }
  }
}
BENCHMARK_CAPTURE(pose, board_plumbline, false, false);
BENCHMARK_CAPTURE(pose, board_opencv, false, true);
BENCHMARK_CAPTURE(pose, solid_plumbline, true, false);
BENCHMARK_CAPTURE(pose, solid_opencv, true, true);

}  // namespace
