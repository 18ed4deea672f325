// SPDX-License-Identifier: Apache-2.0
// What every lens of the list must do. Typed over the variant Lens: a new lens is tested as soon as its name
// is there.
#include <ceres/jet.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <set>

#include "support/lens_samples.hpp"

namespace plumbline {
namespace {

using namespace test;

template <class L>
class LensConformance : public ::testing::Test {
 protected:
  // Calls body(lens, points) for many lenses of each size of distortion.
  template <class Body>
  void for_lenses(int n_lenses, int n_points, Body&& body) {
    Rng rng(20240601);
    for (double distortion : distortions()) {
      int n_inside = 0;
      for (int i = 0; i < n_lenses; ++i) {
        const L lens = random_lens<L>(rng, distortion);
        const auto points = points_in_domain(lens, rng, n_points);
        n_inside += static_cast<int>(points.size());
        SCOPED_TRACE("lens " + std::to_string(i) + " with distortion " + std::to_string(distortion));
        body(lens, points);
        if (this->HasFatalFailure()) return;
      }
      // Even a wild lens has a domain around its axis, so hardly a point may be lost.
      EXPECT_GT(n_inside, 0.9 * n_lenses * n_points) << "distortion " << distortion;
    }
  }
};
TYPED_TEST_SUITE(LensConformance, LensTypes, LensTypeName);

// Value and derivatives of L::project_t by Ceres' automatic differentiation.
template <class L>
struct Autodiff {
  Vec2 px;
  Mat23 J_px_p;
  JacParams<L> J_px_k;

  Autodiff(const L& lens, const Vec3& p_cam) {
    constexpr int n = L::kNumParams;
    using Jet = ceres::Jet<double, 3 + n>;
    Jet k[n], p[3], q[2];
    for (int i = 0; i < n; ++i) k[i] = Jet((&lens.fx)[i], 3 + i);
    for (int i = 0; i < 3; ++i) p[i] = Jet(p_cam[i], i);
    L::project_t(k, p, q);
    for (int r = 0; r < 2; ++r) {
      px[r] = q[r].a;
      J_px_p.row(r) = q[r].v.template head<3>();
      J_px_k.row(r) = q[r].v.template tail<n>();
    }
  }
};

// Scales: J_px_p against its own largest entry; each column of J_px_k against its largest entry, or 1 px per
// unit of the parameter where that is smaller.
template <class L>
void expect_matches_autodiff(const L& lens, const Vec3& p, double* worst) {
  Mat23 J_px_p;
  JacParams<L> J_px_k;
  const auto px = lens.project(p, &J_px_p, &J_px_k);
  ASSERT_TRUE(px);
  const Autodiff<L> truth(lens, p);
  const Vec2 centre_px(lens.cx, lens.cy);
  EXPECT_LT((*px - truth.px).norm(), 1e-12 * (1 + (truth.px - centre_px).norm())) << p.transpose();
  const double error_p = (J_px_p - truth.J_px_p).cwiseAbs().maxCoeff() / truth.J_px_p.cwiseAbs().maxCoeff();
  EXPECT_LT(error_p, 1e-10) << p.transpose() << "\n" << J_px_p << "\n" << truth.J_px_p;
  *worst = std::max(*worst, error_p);
  for (int i = 0; i < L::kNumParams; ++i) {
    const double scale = std::max(1.0, truth.J_px_k.col(i).cwiseAbs().maxCoeff());
    const double error_k = (J_px_k.col(i) - truth.J_px_k.col(i)).cwiseAbs().maxCoeff() / scale;
    // At the edge of a double sphere a derivative vanishes as the difference of two numbers, in both forms.
    EXPECT_LT(error_k, 3e-10) << L::kParamNames[i] << " at " << p.transpose();
    *worst = std::max(*worst, error_k);
  }
  // Asking for less gives the same.
  EXPECT_EQ(lens.project(p), px);
  EXPECT_EQ(lens.project(p, &J_px_p), px);
}

TYPED_TEST(LensConformance, JacobiansMatchAutomaticDifferentiation) {
  double worst = 0;
  this->for_lenses(60, 60, [&](const auto& lens, const auto& points) {
    for (const Vec3& p : points) expect_matches_autodiff(lens, p, &worst);
  });
  this->RecordProperty("digits", std::to_string(-std::log10(worst)));
}

TYPED_TEST(LensConformance, JacobiansMatchNearTheOpticalAxis) {
  Rng rng(2);
  double worst = 0;
  for (double distortion : distortions()) {
    const auto lens = random_lens<TypeParam>(rng, distortion);
    for (double theta : {1e-15, 1e-12, 1e-10, 0.99e-9, 1.01e-9, 1e-8, 1e-6, 1e-4, 1e-2}) {
      for (double phi : {0.0, 1.0, 3.0, 5.0}) expect_matches_autodiff(lens, point_at(theta, phi, 2), &worst);
    }
    // On the axis itself automatic differentiation may be 0/0; the derivatives just beside it are the same.
    Mat23 on_axis, beside;
    JacParams<TypeParam> on_axis_k, beside_k;
    const auto px = lens.project(Vec3(0, 0, 2), &on_axis, &on_axis_k);
    ASSERT_TRUE(px);
    EXPECT_LT((*px - Vec2(lens.cx, lens.cy)).norm(), 1e-12);
    ASSERT_TRUE(lens.project(Vec3(1e-12, 1e-12, 2), &beside, &beside_k));
    EXPECT_LT((on_axis - beside).norm(), 1e-10 * on_axis.norm());
    EXPECT_LT((on_axis_k - beside_k).norm(),
              1e-8);  // d px/d fx is x itself: 1e-12 of it, times focal lengths
  }
}

// Behind the camera, up to almost straight back. The seed is the lens that sees furthest.
TYPED_TEST(LensConformance, BehindTheCameraTheDomainDecides) {
  const TypeParam lens = TypeParam::seed({1280, 960}, 300);
  double worst = 0;
  for (double from_back : {1.5, 1.0, 0.1, 1e-3, 1e-6, 1e-9, 1e-10, 1e-12}) {
    const Vec3 p(std::sin(from_back), 0, -std::cos(from_back));
    const auto px = lens.project(p);
    if (TypeParam::kIsCentralPerspective) {
      EXPECT_FALSE(px) << from_back;
    } else if (px && (*px - Vec2(lens.cx, lens.cy)).norm() < kFarthestPx) {
      expect_matches_autodiff(lens, p, &worst);
      const auto ray = unproject(Lens(lens), *px);
      ASSERT_TRUE(ray) << from_back;
      EXPECT_LT((*ray - p).norm(), 1e-11) << from_back;
    }
  }
  EXPECT_FALSE(lens.project(Vec3(0, 0, -1)));  // straight back has no direction in the image
}

// A pixel depends on the direction of the point only.
TYPED_TEST(LensConformance, EulerIdentityAndScale) {
  this->for_lenses(40, 40, [&](const auto& lens, const auto& points) {
    for (const Vec3& p : points) {
      Mat23 J;
      const auto px = lens.project(p, &J);
      ASSERT_TRUE(px);
      EXPECT_LT((J * p).norm(), 1e-13 * J.norm() * p.norm());
      const auto halved = lens.project(0.25 * p);
      ASSERT_TRUE(halved);
      EXPECT_EQ(*halved, *px);  // a power of two loses nothing
    }
  });
}

TYPED_TEST(LensConformance, UnprojectionIsTheInverse) {
  double worst_px = 0;
  this->for_lenses(60, 40, [&](const auto& lens, const auto& points) {
    for (const Vec3& p : points) {
      const Vec3 ray = p.normalized();
      Mat23 J;
      const Vec2 px = lens.project(ray, &J).value();
      const auto back = unproject(Lens(lens), px);
      ASSERT_TRUE(back) << "theta " << std::atan2(p.head<2>().norm(), p.z()) << " px " << px.transpose();
      EXPECT_NEAR(back->norm(), 1, 1e-15);
      const auto again = lens.project(*back);
      ASSERT_TRUE(again);
      const double error_px = (*again - px).norm();
      EXPECT_LT(error_px, std::max(1e-9, 1e-10 + 1e-13 * px.norm()));
      worst_px = std::max(worst_px, error_px);
      // The same ray, to what that pixel error means where the map is flattest (smallest singular value of
      // J).
      const Mat2 JJ = J * J.transpose();
      const double smallest = std::sqrt(std::max(0.0, JJ.determinant() / JJ.trace()));
      EXPECT_LT((*back - ray).norm(), 1e-12 + 2e-9 / smallest) << "px " << px.transpose();
    }
  });
  this->RecordProperty("log10_worst_px", std::to_string(std::log10(worst_px)));
}

TYPED_TEST(LensConformance, UnprojectsEveryCornerOfAnImageThatItCovers) {
  Rng rng(4);
  for (int i = 0; i < 200; ++i) {
    const TypeParam lens = random_lens<TypeParam>(rng, i % 2 == 0 ? 0.005 : 0.0);
    for (const Vec2& px : {Vec2(-0.5, -0.5), Vec2(1279.5, -0.5), Vec2(-0.5, 959.5), Vec2(1279.5, 959.5),
                           Vec2(lens.cx, lens.cy)}) {
      const auto ray = unproject(Lens(lens), px);
      if (i % 2 == 1 && TypeParam::kIsCentralPerspective) {
        ASSERT_TRUE(ray) << px.transpose();
      }
      if (ray) {
        EXPECT_LT((lens.project(*ray).value() - px).norm(), 1e-9);
      }
    }
  }
}

TYPED_TEST(LensConformance, UnprojectionOutsideTheImageOfTheDomainSaysNothing) {
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  const Lens seed = TypeParam::seed({640, 480}, 300);
  for (const Vec2& px : {Vec2(nan, 0), Vec2(0, nan), Vec2(inf, 0), Vec2(0, -inf)})
    EXPECT_FALSE(unproject(seed, px));
  // Whatever the lens and the pixel: nothing, or a ray that projects there.
  Rng rng(5);
  for (int i = 0; i < 400; ++i) {
    const TypeParam lens = random_lens<TypeParam>(rng, distortions()[i % 4]);
    const Vec2 px(rng.uniform(-5000, 5000), rng.uniform(-5000, 5000));
    const auto ray = unproject(Lens(lens), px);
    if (!ray) continue;
    const auto again = lens.project(*ray);
    ASSERT_TRUE(again);
    EXPECT_LT((*again - px).norm(), 1e-9);
  }
}

// Outward along a direction the image moves outward without turning back, until the domain ends; and it ends
// once.
TYPED_TEST(LensConformance, TheDomainIsOnePieceWithoutAFold) {
  Rng rng(6);
  for (double distortion : distortions()) {
    for (int i = 0; i < 150; ++i) {
      const TypeParam lens = random_lens<TypeParam>(rng, distortion);
      const double phi = rng.uniform(0, 2 * std::numbers::pi);
      const Vec2 direction(std::cos(phi), std::sin(phi));
      double before = 0;
      bool ended = false;
      const int n = 1500;
      for (int step = 1; step <= n; ++step) {
        const auto px = lens.project(point_at(widest_angle<TypeParam>() * step / n, phi));
        if (!px) ended = true;
        if (!px || ended) {
          ASSERT_FALSE(px) << "the domain begins again; lens " << i << ", distortion " << distortion;
          continue;
        }
        const double along =
            direction.dot(Vec2((px->x() - lens.cx) / lens.fx, (px->y() - lens.cy) / lens.fy));
        ASSERT_GT(along, before) << "the image folds back; lens " << i << ", distortion " << distortion
                                 << ", step " << step;
        before = along;
      }
    }
  }
}

// The same, at the edge itself, where a step of the walk above may be too coarse.
TYPED_TEST(LensConformance, TheImageStillMovesOutwardAtTheEdge) {
  Rng rng(7);
  for (int i = 0; i < 600; ++i) {
    const TypeParam lens = random_lens<TypeParam>(rng, distortions()[1 + i % 3]);
    const double phi = rng.uniform(0, 2 * std::numbers::pi), edge = edge_of_domain(lens, phi);
    const Vec2 direction(std::cos(phi), std::sin(phi));
    const auto along = [&](double theta) {
      const Vec2 px = lens.project(point_at(theta, phi)).value();
      return direction.dot(Vec2((px.x() - lens.cx) / lens.fx, (px.y() - lens.cy) / lens.fy));
    };
    for (double gap : {1e-2, 1e-3, 1e-4}) EXPECT_GT(along(edge * (1 - 1e-9)), along(edge * (1 - gap))) << gap;
  }
}

TYPED_TEST(LensConformance, WhatIsNotAPointIsNotProjected) {
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  Rng rng(8);
  for (double distortion : distortions()) {
    const TypeParam lens = random_lens<TypeParam>(rng, distortion);
    for (double bad : {nan, inf, -inf}) {
      for (int i = 0; i < 3; ++i) {
        Vec3 p(0.01, 0.02, 1);
        p[i] = bad;
        EXPECT_FALSE(lens.project(p)) << p.transpose();
        Vec3 on_axis(0, 0, 1);
        on_axis[i] = bad;
        EXPECT_FALSE(lens.project(on_axis)) << on_axis.transpose();
      }
    }
    EXPECT_FALSE(lens.project(Vec3::Zero()));
    EXPECT_FALSE(lens.project(Vec3(-0.0, 0.0, -0.0)));
    EXPECT_FALSE(lens.project(Vec3(1e308, 1e308, 1e-308)));
    if (TypeParam::kIsCentralPerspective) {
      EXPECT_FALSE(lens.project(Vec3(0.01, 0, 0)));
      EXPECT_FALSE(lens.project(Vec3(0.01, 0, -1)));
      EXPECT_FALSE(lens.project(Vec3(0.01, 0, -1e-300)));
    }
  }
}

TYPED_TEST(LensConformance, AParameterThatIsNotANumberGivesNoPixel) {
  for (double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    for (int i = 0; i < TypeParam::kNumParams; ++i) {
      TypeParam lens = TypeParam::seed({640, 480}, 300);
      (&lens.fx)[i] = bad;
      EXPECT_FALSE(lens.project(Vec3(0.1, 0.2, 1))) << TypeParam::kParamNames[i] << " = " << bad;
    }
  }
}

TYPED_TEST(LensConformance, TheSeedIsFreeOfDistortionAtTheCentre) {
  const TypeParam lens = TypeParam::seed({640, 480}, 300);
  Mat23 J, expected;
  expected << 150, 0, 0, 0, 150, 0;
  ASSERT_TRUE(lens.project(Vec3(0, 0, 2), &J));
  EXPECT_LT((J - expected).norm(), 1e-12);
  EXPECT_EQ(*lens.project(Vec3(0, 0, 2)), Vec2(319.5, 239.5));
  for (double phi = 0; phi < 6.28; phi += 0.1) {
    EXPECT_TRUE(lens.project(point_at(80 * std::numbers::pi / 180, phi))) << "a seed must see wide boards";
  }
}

TYPED_TEST(LensConformance, IsKnownByItsNameEverywhere) {
  const std::string_view name = TypeParam::kName;
  Rng rng(9);
  const TypeParam lens = random_lens<TypeParam>(rng, 0.05);
  Lens any = lens;
  EXPECT_EQ(lens_name(any), name);
  EXPECT_FALSE(lens_summary(any).empty());
  EXPECT_EQ(n_params(any), TypeParam::kNumParams);
  EXPECT_LE(n_params(any), kMaxLensParams);
  const auto names = param_names(any);
  ASSERT_EQ(names.size(), static_cast<std::size_t>(TypeParam::kNumParams));
  EXPECT_EQ(std::set<std::string_view>(names.begin(), names.end()).size(), names.size());
  for (int i = 0; i < 4; ++i) EXPECT_EQ(names[i], (std::array{"fx", "fy", "cx", "cy"}[i]));
  // The parameters are the struct, in the order of the names, and make the same lens again.
  const Lens& read_only = any;
  const auto rebuilt = make_lens(name, params(read_only));
  ASSERT_TRUE(rebuilt);
  Mat23 J_p, J_p_any;
  JacParams<TypeParam> J_k;
  JacLens J_k_any;
  const Vec3 p(0.05, -0.03, 1);
  const auto px = lens.project(p, &J_p, &J_k);
  EXPECT_EQ(project(*rebuilt, p, &J_p_any, &J_k_any), px);
  EXPECT_EQ(J_p, J_p_any);
  EXPECT_EQ(MatX(J_k), MatX(J_k_any));
  params(any)[2] += 1;
  EXPECT_DOUBLE_EQ(project(any, p)->x(), px->x() + 1);
  EXPECT_EQ(is_central_perspective(any), TypeParam::kIsCentralPerspective);
}

TEST(LensList, NamesAreUnique) {
  const auto names = lens_names();
  EXPECT_EQ(names.size(), std::variant_size_v<Lens>);
  EXPECT_EQ(std::set<std::string_view>(names.begin(), names.end()).size(), names.size());
}

}  // namespace
}  // namespace plumbline
