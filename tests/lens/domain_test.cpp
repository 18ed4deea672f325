// SPDX-License-Identifier: Apache-2.0
// The domains of the lenses that we have: neither too wide (the image never folds) nor needlessly narrow.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "support/lens_samples.hpp"

namespace plumbline {
namespace {

using namespace test;

// Where the radial map of project_t, walked outward in small steps, first turns back or jumps through a pole.
template <class L>
double first_fold(const L& lens, double widest) {
  const int n = 40000;
  double before = 0, slope_before = 0;
  for (int i = 1; i < n; ++i) {
    const Vec3 p = point_at(widest * i / n, 0.3);
    double px[2];
    L::project_t(&lens.fx, p.data(), px);
    const double radius =
        (px[0] - lens.cx) / lens.fx / std::cos(0.3);  // signed, along the direction of the walk
    if (!(radius > before) || (slope_before > 0 && radius - before > 1e3 * slope_before))
      return widest * (i - 1) / n;
    slope_before = radius - before;
    before = radius;
  }
  return widest;
}

template <class L>
class RadialEdge : public ::testing::Test {};
using RadialLenses = ::testing::Types<OpenCV4, OpenCV5, OpenCV8, OpenCV12, KannalaBrandt4, UnifiedCamera,
                                      EnhancedUnifiedCamera, DoubleSphere>;
TYPED_TEST_SUITE(RadialEdge, RadialLenses, LensTypeName);

// Without tangential and prism terms the domain ends exactly where the image would fold.
TYPED_TEST(RadialEdge, IsTheFirstFold) {
  Rng rng(1);
  int folded = 0;
  for (int i = 0; i < 60; ++i) {
    TypeParam lens = random_lens<TypeParam>(rng, 0.3);
    if constexpr (TypeParam::kIsCentralPerspective) {
      lens.d[2] = lens.d[3] = 0;
      for (std::size_t k = 8; k < lens.d.size(); ++k) lens.d[k] = 0;
    }
    const double fold = first_fold(lens, widest_angle<TypeParam>()), edge = edge_of_domain(lens, 0.3);
    // A step of the walk, and what the walk cannot see of a minimum: the square root of its resolution.
    EXPECT_NEAR(edge, fold, 3 * widest_angle<TypeParam>() / 40000 + 1e-3 * (fold > 1.5)) << i;
    folded += fold < 0.99 * widest_angle<TypeParam>();
  }
  EXPECT_GT(folded, 20);
}

// Monotone: (f(a) - f(b)) . (a - b) > 0 for any two points of the domain, which makes f one to one.
template <class L>
void expect_monotone(Rng& rng, double distortion) {
  const L lens = random_lens<L>(rng, distortion);
  const double edge = std::tan(edge_of_domain(lens, 0.0));
  std::vector<Vec2> at, image;
  for (int i = 0; i < 60; ++i) {
    const double r = edge * (i % 3 == 0 ? 0.999 : std::sqrt(rng.uniform())), phi = rng.uniform(0, 6.2831853);
    at.emplace_back(r * std::cos(phi), r * std::sin(phi));
    const auto px = lens.project(Vec3(at.back().x(), at.back().y(), 1));
    ASSERT_TRUE(px) << "the domain is not a disc";
    image.emplace_back((px->x() - lens.cx) / lens.fx, (px->y() - lens.cy) / lens.fy);
  }
  for (std::size_t i = 0; i < at.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) EXPECT_GT((image[i] - image[k]).dot(at[i] - at[k]), 0);
  }
}

TEST(BrownConradyDomain, IsADiscOnWhichTheMapIsOneToOne) {
  Rng rng(2);
  for (int i = 0; i < 100; ++i) {
    for (double distortion : {0.02, 0.2, 2.0}) {
      expect_monotone<OpenCV4>(rng, distortion);
      expect_monotone<OpenCV5>(rng, distortion);
      expect_monotone<OpenCV8>(rng, distortion);
      expect_monotone<OpenCV12>(rng, distortion);
    }
  }
}

// The bound for the tangential terms is attained: in the worst direction the image stands still at the edge.
TEST(BrownConradyDomain, TangentialBoundIsSharp) {
  OpenCV5 lens{1, 1, 0, 0, {-0.3, 0, 0.004, 0.003, 0}};
  const double edge = std::tan(edge_of_domain(lens, 0.0)), free_edge = std::sqrt(1 / 0.9);
  EXPECT_LT(edge, free_edge);
  EXPECT_GT(edge, 0.97 * free_edge);
  const Vec2 worst = -Vec2(lens.d[3], lens.d[2]).normalized();
  Mat23 J;
  const Vec2 at = edge * (1 - 1e-9) * worst;
  ASSERT_TRUE(lens.project(Vec3(at.x(), at.y(), 1), &J));
  EXPECT_NEAR(worst.dot(J.leftCols<2>() * worst), 0, 1e-8);
  EXPECT_GT((-worst).dot(J.leftCols<2>() * -worst), -1e-8);
}

TEST(BrownConradyDomain, EndsBeforeAPole) {
  const OpenCV8 lens{500, 500, 0, 0, {0, 0, 0, 0, 0, -1, 0, 0}};  // 1 / (1 - s): a pole at 45 degrees
  EXPECT_TRUE(lens.project(Vec3(0.999, 0, 1)));
  EXPECT_FALSE(lens.project(Vec3(1, 0, 1)));
  EXPECT_FALSE(lens.project(Vec3(2, 0, 1)));
}

TEST(KannalaBrandtDomain, ReachesBehindTheCameraUntilTheFold) {
  const KannalaBrandt4 wide{300, 300, 0, 0, 0, 0, 0, 0};
  const auto px = wide.project(point_at(3.0, 0.5));
  ASSERT_TRUE(px);
  EXPECT_LT((*px - 900 * Vec2(std::cos(0.5), std::sin(0.5))).norm(), 1e-10);
  // theta - theta^3 / 12 turns back at 2 rad, behind the camera.
  const KannalaBrandt4 folded{300, 300, 0, 0, -1.0 / 12, 0, 0, 0};
  EXPECT_NEAR(edge_of_domain(folded, 1.0), 2.0, 1e-9);
}

TEST(SphereDomain, OfMeiIsThatOfBothItsParts) {
  // xi > 1: the image turns back where cos(theta) = -1 / xi.
  EXPECT_NEAR(edge_of_domain(Mei{500, 500, 0, 0, 1.25, {}}, 1.0), std::acos(-0.8), 1e-9);
  // xi < 1: it runs off to infinity where cos(theta) = -xi.
  EXPECT_NEAR(edge_of_domain(Mei{500, 500, 0, 0, 0.5, {}}, 1.0), std::acos(-0.5), 1e-9);
  // rho - 0.3 rho^3 turns back at rho^2 = 1 / 0.9; xi = 1 makes that tan(theta / 2).
  EXPECT_NEAR(edge_of_domain(Mei{500, 500, 0, 0, 1, {-0.3, 0, 0, 0}}, 1.0), 2 * std::atan(std::sqrt(1 / 0.9)),
              1e-9);
  EXPECT_FALSE((Mei{500, 500, 0, 0, -1.001, {}}.project(Vec3(0, 0, 1))));
}

TEST(OneParameterDomain, ReachesAllAroundOrToTheEdge) {
  const FieldOfView fov{300, 300, 0, 0, 0.9}, mirrored{300, 300, 0, 0, -0.9}, narrow{300, 300, 0, 0, 0};
  for (const double theta : {0.3, 1.0, 2.0, 3.1}) {
    // r_d = atan2(2 tan(w/2) sin, cos) / w, by hand.
    const double r = 300 * std::atan2(2 * std::tan(0.45) * std::sin(theta), std::cos(theta)) / 0.9;
    EXPECT_NEAR(fov.project(point_at(theta, 0))->x(), r, 1e-10) << theta;
    EXPECT_NEAR(mirrored.project(point_at(theta, 0))->x(), r, 1e-10) << theta;
  }
  EXPECT_NEAR(narrow.project(Vec3(0.7, 0, 1))->x(), 210, 1e-10);
  EXPECT_FALSE((FieldOfView{300, 300, 0, 0, 3.2}.project(Vec3(0.1, 0, 1))));
  const Division barrel{300, 300, 0, 0, -0.2}, cushion{300, 300, 0, 0, 0.1};
  EXPECT_TRUE(barrel.project(point_at(3.1, 0.4)));
  EXPECT_NEAR(edge_of_domain(cushion, 0.4), std::atan(std::sqrt(0.99 / 0.4)), 1e-9);
}

// Lenses as cameras have them: the whole image lies in the domain. Values: OpenCV's sample stereo pair, the
// fisheye of OpenCV's own tests, and a rational fit of a 90 degree colour camera with nearly cancelling
// terms.
TEST(RealLenses, SeeTheirWholeImage) {
  struct Known {
    Lens lens;
    ImageSize size;
  };
  const std::vector<Known> known{
      {OpenCV5{532.83, 532.95, 342.49, 233.86, {-0.2809, 0.0252, 0.0012, -0.0001, 0.1634}}, {640, 480}},
      {OpenCV5{537.45, 536.97, 327.59, 248.88, {-0.2975, 0.1497, -0.0008, 0.0003, -0.0660}}, {640, 480}},
      {KannalaBrandt4{558.478, 560.507, 620.459, 381.939, -0.0014613, -0.0032986, 0.0060576, -0.0037421},
       {1280, 800}},
      {OpenCV8{608, 608, 639, 367, {0.52, -2.71, 0.0006, -0.0003, 1.61, 0.40, -2.53, 1.53}}, {1280, 720}}};
  for (const Known& k : known) {
    for (int y = 0; y <= 12; ++y) {
      for (int x = 0; x <= 16; ++x) {
        const Vec2 px(-0.5 + k.size.width * x / 16.0, -0.5 + k.size.height * y / 12.0);
        const auto ray = unproject(k.lens, px);
        ASSERT_TRUE(ray) << lens_name(k.lens) << " " << px.transpose();
        EXPECT_LT((*project(k.lens, *ray) - px).norm(), 1e-9);
      }
    }
  }
}

}  // namespace
}  // namespace plumbline
