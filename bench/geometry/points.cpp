// SPDX-License-Identifier: Apache-2.0
// Points of space from two or more views.
extern "C" {
#include <mrcal/triangulation.h>
}

#include <cmath>
#include <opencv2/calib3d.hpp>

#include "geometry/geometry.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/linear/triangulate.hpp"
#include "plumbline/refine/point.hpp"

namespace plumbline::bench {
namespace {

// One point before a few pinhole cameras side by side, 0.5 px of noise.
struct PointProblem {
  std::vector<PosedLens> cameras;
  std::vector<Mat34> P;
  std::vector<cv::Matx34d> cv_P;
  Mat3 F;  // of the first two views
  cv::Matx33d cv_F;
  Vec3 p_world;
  std::vector<Vec2> px;
  Vec3 ray_1, ray_2_in_1;  // unit, in the first camera's frame
  Vec3 t_12;
};

std::vector<PointProblem> point_problems(int n_problems, int n_views, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<PointProblem> list;
  while (static_cast<int>(list.size()) < n_problems) {
    PointProblem p;
    p.p_world = Vec3(rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(3, 8));
    const Mat3 K = random_k(rng);
    for (int v = 0; v < n_views; ++v) {
      const double a = rng.normal(0.05), b = rng.normal(0.05);
      const Vec3 centre(v * 0.5, rng.normal(0.1), rng.normal(0.1));
      const Mat3 R = so3_exp(Vec3(a, b, rng.normal(0.05)));
      const SE3 T = v == 0 ? SE3() : SE3(R, -R * centre);
      const Vec2 exact = (K * (T * p.p_world)).hnormalized();
      if (!in_image(exact)) break;
      p.cameras.push_back({Pinhole{K(0, 0), K(1, 1), K(0, 2), K(1, 2)}, T});
      p.P.push_back(K * T.matrix34());
      cv::Matx34d P;
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 4; ++c) P(r, c) = p.P.back()(r, c);
      p.cv_P.push_back(P);
      p.px.push_back(noisy(rng, exact));
    }
    if (static_cast<int>(p.px.size()) < n_views) continue;
    const SE3& T = p.cameras[1].T_cam_world;
    p.F = K.transpose().inverse() * skew(T.t()) * T.R() * K.inverse();
    p.cv_F = to_cv(p.F);
    p.ray_1 = (K.inverse() * p.px[0].homogeneous()).normalized();
    p.ray_2_in_1 = T.R().transpose() * (K.inverse() * p.px[1].homogeneous()).normalized();
    p.t_12 = T.centre();
    list.push_back(std::move(p));
  }
  return list;
}

double error_permille(const PointProblem& p, const Vec3& found) {
  return 1000 * (found - p.p_world).norm() / p.p_world.norm();
}

using Problems = std::shared_ptr<const std::vector<PointProblem>>;

template <class Solve>
void add(std::vector<Method>& list, const std::string& group, const std::string& name,
         const Problems& problems, Solve solve) {
  list.push_back(method(
      group, name, 300, problems, [solve](const PointProblem& p) -> std::optional<Vec3> { return solve(p); },
      error_permille));
}

std::optional<Vec3> dehomogenised(const Result<Vec4>& X) {
  if (!X) return std::nullopt;
  return Vec3(X->hnormalized());
}

std::optional<Vec3> refined(const PointProblem& p) {
  const auto start = triangulate(p.cameras, p.px, kNoise_px);
  if (!start) return std::nullopt;
  const auto found = refine_point(start->p_world, p.cameras, p.px, kNoise_px);
  if (!found) return std::nullopt;
  return found->p_world;
}

std::optional<Vec3> linear_and_more(const PointProblem& p) {
  const auto found = triangulate(p.cameras, p.px, kNoise_px);
  if (!found) return std::nullopt;
  return found->p_world;
}

Vec3 to_vec3(const cv::Mat& X) {
  return Vec3(X.at<double>(0), X.at<double>(1), X.at<double>(2)) / X.at<double>(3);
}

// OpenCV triangulates many points of one pair at a time; here, as in the other methods, one point a call.
Vec3 opencv_linear(const PointProblem& p, const cv::Point2d& a, const cv::Point2d& b) {
  cv::Mat X;
  cv::triangulatePoints(p.cv_P[0], p.cv_P[1], std::vector<cv::Point2d>{a}, std::vector<cv::Point2d>{b}, X);
  return to_vec3(X);
}

Vec3 opencv_optimal(const PointProblem& p) {
  const std::vector<cv::Point2d> a{{p.px[0].x(), p.px[0].y()}}, b{{p.px[1].x(), p.px[1].y()}};
  std::vector<cv::Point2d> a2, b2;
  cv::correctMatches(p.cv_F, a, b, a2, b2);
  return opencv_linear(p, a2[0], b2[0]);
}

mrcal_point3_t to_mrcal(const Vec3& v) {
  mrcal_point3_t p;
  p.x = v.x(), p.y = v.y(), p.z = v.z();
  return p;
}

using MrcalFunction = decltype(&mrcal_triangulate_geometric);
template <MrcalFunction F>
Vec3 by_mrcal(const PointProblem& p) {
  const mrcal_point3_t v0 = to_mrcal(p.ray_1), v1 = to_mrcal(p.ray_2_in_1), t = to_mrcal(p.t_12);
  const mrcal_point3_t X = F(nullptr, nullptr, nullptr, &v0, &v1, &t);
  return {X.x, X.y, X.z};
}

}  // namespace

void add_point_methods(std::vector<Method>& list) {
  const std::string two = "point from 2 views [permille]";
  const Problems pairs = share(point_problems(1000, 2, 31));
  add(list, two, "triangulate_linear", pairs,
      [](const PointProblem& p) { return dehomogenised(triangulate_linear(p.P, p.px)); });
  add(list, two, "triangulate_midpoint", pairs, [](const PointProblem& p) -> std::optional<Vec3> {
    const std::vector<WorldRay> rays{{Vec3::Zero(), p.ray_1}, {p.t_12, p.ray_2_in_1}};
    const auto found = triangulate_midpoint(rays);
    if (!found) return std::nullopt;
    return *found;
  });
  add(list, two, "triangulate_optimal", pairs, [](const PointProblem& p) {
    return dehomogenised(triangulate_optimal(p.P[0], p.P[1], p.px[0], p.px[1]));
  });
  add(list, two, "triangulate (any lens, covariance)", pairs, linear_and_more);
  add(list, two, "triangulate + refine_point", pairs, refined);
  add(list, two, "cv::triangulatePoints", pairs, [](const PointProblem& p) {
    return opencv_linear(p, {p.px[0].x(), p.px[0].y()}, {p.px[1].x(), p.px[1].y()});
  });
  add(list, two, "cv::correctMatches + triangulatePoints", pairs, opencv_optimal);
  add(list, two, "mrcal geometric", pairs, by_mrcal<mrcal_triangulate_geometric>);
  add(list, two, "mrcal leecivera_mid2", pairs, by_mrcal<mrcal_triangulate_leecivera_mid2>);
  const std::string five = "point from 5 views [permille]";
  const Problems many = share(point_problems(1000, 5, 32));
  add(list, five, "triangulate_linear", many,
      [](const PointProblem& p) { return dehomogenised(triangulate_linear(p.P, p.px)); });
  add(list, five, "triangulate (any lens, covariance)", many, linear_and_more);
  add(list, five, "triangulate + refine_point", many, refined);
}

}  // namespace plumbline::bench
