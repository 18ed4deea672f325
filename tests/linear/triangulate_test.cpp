// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/triangulate.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <opencv2/calib3d.hpp>

extern "C" {
#include <mrcal/triangulation.h>
}

#include "linear/scenes.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

Lens lens_of(std::string_view name, std::vector<double> k) { return make_lens(name, k).value(); }

const Lens kPinhole = lens_of("pinhole", {800, 810, 640, 480});
const Lens kWide = lens_of("kb4", {300, 301, 640, 480, -0.012, 0.004, -0.0015, 2e-4});

struct Scene {
  std::vector<PosedLens> cameras;
  Vec3 p_world;
  std::vector<Vec2> px;
};

// n cameras on a baseline of 1.5 m that look at a point 2 to 6 m away; with a wide lens the point may be to the
// side of a camera. Somewhere in the world.
Scene random_scene(Rng& rng, int n, bool wide, double sigma_px = 0) {
  Scene s;
  const SE3 T_any_world(random_rotation(rng), random_vec3(rng, -3, 3));
  const Vec3 p = rng.uniform(2, 6) * Vec3(rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), 1);
  s.p_world = T_any_world.inverse() * p;
  while (static_cast<int>(s.px.size()) < n) {
    Vec3 centre = random_vec3(rng, -0.2, 0.2);
    centre.x() += 1.5 * static_cast<double>(s.px.size()) / (n - 1) - 0.75;
    const Mat3 R = so3_exp((wide ? 1.5 : 0.15) * random_direction(rng));
    const Lens& lens = wide && rng.uniform() < 0.7 ? kWide : kPinhole;
    const SE3 T_cam_any(R, -R * centre);
    const auto px = project(lens, T_cam_any * p);
    if (!px || (*px - Vec2(640, 480)).norm() > 900) continue;
    s.cameras.push_back({lens, T_cam_any * T_any_world});
    s.px.push_back(*px + sigma_px * Vec2(rng.normal(), rng.normal()));
  }
  return s;
}

std::vector<Mat34> matrices(const Scene& s) {
  std::vector<Mat34> P;
  for (const PosedLens& c : s.cameras) P.push_back(camera_matrix_k(c.lens) * c.T_cam_world.matrix34());
  return P;
}

std::vector<WorldRay> rays(const Scene& s) {
  std::vector<WorldRay> r;
  for (std::size_t i = 0; i < s.px.size(); ++i) {
    const SE3 T_world_cam = s.cameras[i].T_cam_world.inverse();
    r.push_back({T_world_cam.t(), T_world_cam.R() * *unproject(s.cameras[i].lens, s.px[i])});
  }
  return r;
}

TEST(Triangulate, IsExactWithoutNoise) {
  Rng rng(1);
  std::vector<double> errors;
  const auto add = [&](const Vec3& p, const Scene& s) {
    errors.push_back((p - s.p_world).norm() / s.p_world.norm());
  };
  for (int i = 0; i < 10000; ++i) {
    const Scene wide = random_scene(rng, 2 + rng.index(4), true),
                s = random_scene(rng, 2 + rng.index(4), false);
    const auto any = triangulate(wide.cameras, wide.px, 0.1);
    ASSERT_TRUE(any) << any.error().text();
    EXPECT_LT(any->rms_px, 1e-8);
    add(any->p_world, wide);
    const auto P = matrices(s);
    add(triangulate(P, s.px, 0.1).value().p_world, s);
    add(triangulate_linear(P, s.px).value().hnormalized(), s);
    add(triangulate_midpoint(rays(wide)).value(), wide);
    add(triangulate_optimal(P[0], P[1], s.px[0], s.px[1]).value().hnormalized(), s);
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[49500], 1e-9);
  EXPECT_LT(errors.back(), 1e-7);
}

TEST(Triangulate, StatesTheAngleBetweenTheRays) {
  Rng rng(2);
  for (int i = 0; i < 100; ++i) {
    const Scene s = random_scene(rng, 3, true);
    const auto r = rays(s);
    double largest = 0;
    for (int a = 0; a < 3; ++a) {
      for (int b = 0; b < a; ++b) {
        const double angle = std::acos(r[a].direction.dot(r[b].direction));
        largest = std::max(largest, std::min(angle, std::numbers::pi - angle));
      }
    }
    EXPECT_NEAR(triangulate(s.cameras, s.px, 0.1).value().ray_angle_rad, largest, 1e-7);
  }
}

TEST(Triangulate, TakesCameraMatricesOfAnyScaleAndSign) {
  Rng rng(3);
  for (int i = 0; i < 100; ++i) {
    const Scene s = random_scene(rng, 3, false, 0.5);
    auto P = matrices(s);
    const auto lenses = triangulate(s.cameras, s.px, 0.5).value();
    P[0] *= -3;
    P[1] *= 1e-3;
    const auto scaled = triangulate(P, s.px, 0.5).value();
    EXPECT_LT((scaled.p_world - lenses.p_world).norm(), 1e-9);
    EXPECT_LT((scaled.covariance - lenses.covariance).norm(), 1e-8 * lenses.covariance.norm());
    EXPECT_NEAR(scaled.rms_px, lenses.rms_px, 1e-7);
    // The homogeneous solution weighs views by their P's direction, not its length.
    const Vec3 a = triangulate_linear(matrices(s), s.px).value().hnormalized();
    EXPECT_LT((a - triangulate_linear(P, s.px).value().hnormalized()).norm(), 1e-9);
  }
}

TEST(Triangulate, AgreesWithOpenCV) {
  Rng rng(4);
  for (int i = 0; i < 200; ++i) {
    for (const double sigma : {0.0, 0.3}) {
      const Scene s = random_scene(rng, 2, false, sigma);
      const auto P = matrices(s);
      cv::Mat P1(3, 4, CV_64F), P2(3, 4, CV_64F), X;
      for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 4; ++c) P1.at<double>(r, c) = P[0](r, c), P2.at<double>(r, c) = P[1](r, c);
      }
      const std::vector<cv::Point2d> a{{s.px[0].x(), s.px[0].y()}}, b{{s.px[1].x(), s.px[1].y()}};
      cv::triangulatePoints(P1, P2, a, b, X);
      const Vec3 theirs = Vec4(X.ptr<double>()).hnormalized(),
                 ours = triangulate_linear(P, s.px)->hnormalized();
      // With noise the two weigh the equations differently, which moves the point by a part of its own error.
      const Mat3 C = triangulate(P, s.px, std::max(sigma, 1e-6)).value().covariance;
      EXPECT_LT((ours - theirs).norm(), sigma == 0 ? 1e-9 : 0.5 * std::sqrt(C.trace())) << "problem " << i;
    }
  }
}

TEST(TriangulateMidpoint, AgreesWithMrcal) {
  Rng rng(5);
  for (int i = 0; i < 500; ++i) {
    const Scene s = random_scene(rng, 2, true, 0.5);
    const auto r = rays(s);
    const Vec3 t = r[1].origin - r[0].origin;
    const auto point = [](const Vec3& v) { return mrcal_point3_t{{v.x(), v.y(), v.z()}}; };
    const mrcal_point3_t v0 = point(r[0].direction), v1 = point(r[1].direction), t01 = point(t);
    const mrcal_point3_t m = mrcal_triangulate_geometric(nullptr, nullptr, nullptr, &v0, &v1, &t01);
    const Vec3 theirs = r[0].origin + Vec3(m.x, m.y, m.z);
    EXPECT_LT((triangulate_midpoint(r).value() - theirs).norm(), 1e-10) << "problem " << i;
    // "Mid2" weighs the two rays by angle, the same to first order as the best point in angles.
    const mrcal_point3_t m2 = mrcal_triangulate_leecivera_mid2(nullptr, nullptr, nullptr, &v0, &v1, &t01);
    const auto ours = triangulate(s.cameras, s.px, 0.5).value();
    const double sigma_m = std::sqrt(ours.covariance.trace());
    EXPECT_LT((ours.p_world - r[0].origin - Vec3(m2.x, m2.y, m2.z)).norm(), 5 * sigma_m) << "problem " << i;
  }
}

TEST(TriangulateMidpoint, IsNearestToManyRays) {
  Rng rng(6);
  for (int i = 0; i < 100; ++i) {
    auto r = rays(random_scene(rng, 5, true, 2));
    r[1].direction *= 7;  // any length
    const Vec3 p = triangulate_midpoint(r).value();
    // The gradient of the sum of squared distances vanishes.
    Vec3 gradient = Vec3::Zero();
    for (const WorldRay& ray : r) {
      const Vec3 d = ray.direction.normalized(), to = p - ray.origin;
      gradient += to - d * d.dot(to);
    }
    EXPECT_LT(gradient.norm(), 1e-12);
  }
}

// Rays of a point at infinity, or nearly: with noise they meet anywhere, before or behind.
TEST(Triangulate, RefusesParallelRaysByTheirNoise) {
  Rng rng(7);
  const SE3 left, right(Mat3::Identity(), Vec3(-0.1, 0, 0));
  int passed = 0, named = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vec2 px = *project(kPinhole, Vec3(0.1, -0.2, 1));
    const auto noise = [&]() -> Vec2 { return 0.5 * Vec2(rng.normal(), rng.normal()); };
    const std::vector<Vec2> seen{px + noise(), px + noise()};
    const auto t = triangulate(std::vector<PosedLens>{{kPinhole, left}, {kPinhole, right}}, seen, 0.5);
    passed += t.has_value();
    named += !t && t.error().code == ErrorCode::kDegenerate &&
             t.error().message.starts_with("the rays are parallel");
  }
  EXPECT_LE(passed, 1);  // 4 sigmas on one side: 0.06 expected
  EXPECT_GE(named, 1998);
  // The same cameras, 0.1 m apart, 800 px: 0.5 sqrt(2) px is the sigma of the disparity 80 px m / distance,
  // so that 4 of them are reached at 28 m.
  for (const double distance : {25.0, 32.0}) {
    const Vec3 p(0.1 * distance, -0.2 * distance, distance);
    const std::vector<Vec2> px{*project(kPinhole, p), *project(kPinhole, right * p)};
    const auto t = triangulate(std::vector<PosedLens>{{kPinhole, left}, {kPinhole, right}}, px, 0.5);
    EXPECT_EQ(t.has_value(), distance < 28.28);
    if (t) continue;
    EXPECT_THAT(t.error().message,
                HasSubstr("the largest angle between them is 0.1"));  // 0.1 / 32 cos: 0.17 degrees
    EXPECT_THAT(t.error().message, HasSubstr("standard deviation of 0.0"));
  }
}

TEST(Triangulate, RefusesByName) {
  const SE3 left, right(Mat3::Identity(), Vec3(-0.5, 0, 0));
  const std::vector<PosedLens> two{{kPinhole, left}, {kPinhole, right}};
  const auto px = [&](const Vec3& a, const Vec3& b) {
    return std::vector<Vec2>{*project(kPinhole, a), *project(kPinhole, b)};
  };
  const auto expect = [](const auto& result, ErrorCode code, const char* text) {
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error().code, code) << result.error().text();
    EXPECT_THAT(result.error().message, HasSubstr(text));
  };
  // Swapped pixels: the rays diverge and meet 2 m behind.
  const std::vector<Vec2> swapped = px(right * Vec3(0, 0, 2), Vec3(0, 0, 2));
  expect(triangulate(two, swapped, 0.1), ErrorCode::kInvalidData, "behind camera 0");
  const std::vector<Mat34> P{camera_matrix_k(kPinhole) * left.matrix34(),
                             camera_matrix_k(kPinhole) * right.matrix34()};
  expect(triangulate(P, swapped, 0.1), ErrorCode::kInvalidData, "behind camera 0");
  const std::vector<Vec2> good = px(Vec3(0, 0, 2), right * Vec3(0, 0, 2));
  const std::vector<WorldRay> diverging{{Vec3::Zero(), Vec3(-0.1, 0, 1)}, {Vec3(0.5, 0, 0), Vec3(0.1, 0, 1)}};
  expect(triangulate_midpoint(diverging), ErrorCode::kInvalidData, "behind camera 0");
  const std::vector<WorldRay> same{{Vec3::Zero(), Vec3(-0.1, 0, 1)}, {Vec3(0.5, 0, 0), Vec3(-0.2, 0, 2)}};
  expect(triangulate_midpoint(same), ErrorCode::kDegenerate, "parallel");
  expect(triangulate(std::vector<PosedLens>{two[0], two[0]}, good, 0.1), ErrorCode::kDegenerate, "one place");
  expect(triangulate(two, px(Vec3(0.1, 0, 1), Vec3(0.1, 0, 1)), 1e-6), ErrorCode::kDegenerate, "parallel");
  expect(triangulate(std::span(two).first(1), std::span(good).first(1), 0.1), ErrorCode::kDegenerate,
         "1 view");
  expect(triangulate(two, std::vector<Vec2>{good[0], Vec2(std::nan(""), 0)}, 0.1), ErrorCode::kInvalidData,
         "no ray");
  expect(triangulated_at(Vec3(0, 0, -2), two, good, 0.1), ErrorCode::kInvalidData, "behind camera 0");
  expect(triangulate_linear(std::vector<Mat34>{P[0], P[0]}, std::vector<Vec2>{good[0], good[0]}),
         ErrorCode::kDegenerate, "more than one point");
  std::vector<Mat34> at_infinity = P;
  at_infinity[1].leftCols<3>() << 1, 0, 0, 0, 1, 0, 0, 0, 0;
  expect(triangulate(at_infinity, good, 0.1), ErrorCode::kInvalidData, "no finite centre");
  EXPECT_THROW((void)triangulate(two, good, 0.0), std::invalid_argument);
  EXPECT_THROW((void)triangulate(std::span(two).first(1), good, 1.0), std::invalid_argument);
}

// On the line through the centres the rays are one line, at an angle of 180 degrees for one between them.
TEST(Triangulate, RefusesAPointOnTheBaseline) {
  const SE3 right(so3_exp(Vec3(0, std::numbers::pi, 0)), Vec3(0, 0, 2));  // looks back at the first
  const std::vector<PosedLens> two{{kPinhole, SE3()}, {kPinhole, right}};
  const Vec3 p(0, 0, 1);
  const std::vector<Vec2> px{*project(kPinhole, p), *project(kPinhole, right * p)};
  const auto t = triangulate(two, px, 0.1);
  ASSERT_FALSE(t);
  EXPECT_THAT(t.error().message, HasSubstr("parallel"));
}

TEST(TriangulateLinear, AnswersAtInfinityAndForProjectiveCameras) {
  Rng rng(8);
  const std::vector<PosedLens> two{{kPinhole, SE3()}, {kPinhole, SE3(Mat3::Identity(), Vec3(-0.5, 0, 0))}};
  const Vec3 direction(0.1, 0.2, 1);
  const Vec2 px = *project(kPinhole, direction);
  Mat34 P[] = {camera_matrix_k(kPinhole) * two[0].T_cam_world.matrix34(),
               camera_matrix_k(kPinhole) * two[1].T_cam_world.matrix34()};
  const Vec4 X = triangulate_linear(P, std::vector<Vec2>{px, px}).value();
  EXPECT_LT((X - (Vec4() << direction.normalized(), 0).finished()).norm(), 1e-9);
  // A homography of space moves cameras and point together.
  Mat4 G;
  for (double& g : G.reshaped()) g = rng.normal();
  const Vec4 truth(0.2, -0.1, 3, 1);
  const std::vector<Vec2> seen{(P[0] * truth).hnormalized(), (P[1] * truth).hnormalized()};
  for (Mat34& p : P) p = (p * G.inverse()).eval();
  const Vec4 moved = triangulate_linear(P, seen).value();
  EXPECT_LT(projective_distance(moved, Vec4(G * truth)), 1e-9);
}

}  // namespace
}  // namespace plumbline::test
