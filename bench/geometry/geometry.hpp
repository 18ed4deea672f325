// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <benchmark/benchmark.h>

#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "plumbline/core/random.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/geometry/se3.hpp"

/// The problems of the geometry benchmark and the list of methods that solve them.
namespace plumbline::bench {

inline constexpr ImageSize kSize{1280, 960};
inline constexpr double kNoise_px = 0.5;

/// One way to solve every problem of a group.
struct Method {
  std::string group;  ///< what is solved, with the unit of the error in brackets
  std::string name;   ///< who solves it
  std::size_t n_problems = 0;
  double failure = 0;  ///< an error above this is a failure and not noise; it is counted apart
  std::function<void(std::size_t)> solve;
  std::function<std::optional<double>(std::size_t)> error;
};

/// `solve(problem)` gives an optional answer, `error(problem, answer)` its distance from the truth.
template <class Problem, class Solve, class Error>
Method method(std::string group, std::string name, double failure,
              std::shared_ptr<const std::vector<Problem>> problems, Solve solve, Error error) {
  Method m{std::move(group), std::move(name), problems->size(), failure, {}, {}};
  m.solve = [problems, solve](std::size_t i) { benchmark::DoNotOptimize(solve((*problems)[i])); };
  m.error = [problems, solve, error](std::size_t i) -> std::optional<double> {
    const auto answer = solve((*problems)[i]);
    if (!answer) return std::nullopt;
    return error((*problems)[i], *answer);
  };
  return m;
}

template <class T>
std::shared_ptr<const std::vector<T>> share(std::vector<T> v) {
  return std::make_shared<const std::vector<T>>(std::move(v));
}

/// Pixels of two images, in both libraries' types.
struct Pairs {
  std::vector<Vec2> px1, px2;
  std::vector<cv::Point2d> cv1, cv2;
  void add(const Vec2& a, const Vec2& b) {
    px1.push_back(a), px2.push_back(b);
    cv1.emplace_back(a.x(), a.y()), cv2.emplace_back(b.x(), b.y());
  }
};

Vec2 noisy(Rng& rng, const Vec2& px, double sigma = kNoise_px);
Vec2 random_pixel(Rng& rng);
bool in_image(const Vec2& px);
Mat3 random_k(Rng& rng);
cv::Matx33d to_cv(const Mat3& M);
Mat3 to_mat3(const cv::Mat& M);  ///< of 3x3 doubles
double angle_deg(const Mat3& R);
double angle_deg(const Vec3& a, const Vec3& b);

void add_plane_methods(std::vector<Method>& list);
void add_two_view_methods(std::vector<Method>& list);
void add_pose_methods(std::vector<Method>& list);
void add_point_methods(std::vector<Method>& list);

}  // namespace plumbline::bench
