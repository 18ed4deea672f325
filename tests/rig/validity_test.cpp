// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rig/validity.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "plumbline/core/random.hpp"

namespace plumbline {
namespace {

// The radial map of opencv5 walked outward in small steps by its formula: the tangent at which it first turns
// back. Knows nothing of roots.
double first_turn(const OpenCV5& lens) {
  double before = 0;
  for (double r = 1e-4; r < 20; r += 1e-4) {
    const double s = r * r, out = r * (1 + s * (lens.d[0] + s * (lens.d[1] + s * lens.d[4])));
    if (!(out > before)) return r - 1e-4;
    before = out;
  }
  return INFINITY;
}

TEST(Validity, TheDomainEndsWhereTheRadialMapTurns) {
  const OpenCV5 lens{400, 400, 319.5, 239.5, {-0.2, 0.05, 0, 0, -0.04}};
  EXPECT_NEAR(std::tan(domain_angle_rad(lens)), first_turn(lens), 2e-4);
  EXPECT_NEAR(domain_angle_rad(Pinhole{400, 400, 0, 0}), std::numbers::pi / 2, 1e-8);
  EXPECT_NEAR(domain_angle_rad(KannalaBrandt4{300, 300, 0, 0, 0, 0, 0, 0}), std::numbers::pi, 1e-8);
  // theta - theta^3 / 12 turns at 2 rad.
  EXPECT_NEAR(domain_angle_rad(KannalaBrandt4{300, 300, 0, 0, -1.0 / 12, 0, 0, 0}), 2.0, 1e-8);
}

// Lenses at random: what folds_in_image() says against a walk along the radius to the farthest corner.
TEST(Validity, FoldsInImageAsADenseWalkSays) {
  Rng rng(3);
  int folds = 0;
  for (int i = 0; i < 300; ++i) {
    OpenCV5 lens{400, 400, 319.5, 239.5, {}};
    for (int k : {0, 1, 4}) lens.d[static_cast<std::size_t>(k)] = rng.normal(0.15);
    const double turn = first_turn(lens), s = turn * turn;
    const double reach_px =
        std::isfinite(turn) ? 400 * turn * (1 + s * (lens.d[0] + s * (lens.d[1] + s * lens.d[4]))) : INFINITY;
    const double corner_px = std::hypot(319.5, 239.5);
    if (std::abs(reach_px - corner_px) < 0.1) continue;  // the walk cannot tell
    const bool by_walk = reach_px < corner_px;
    EXPECT_EQ(folds_in_image({"c", {640, 480}, lens}), by_walk) << i;
    folds += by_walk;
  }
  EXPECT_GT(folds, 50);
  EXPECT_LT(folds, 250);
}

// The radial map of a rational lens, (1 + n s) / (1 + q s) r with q < 0, rises all the way to its pole at
// s = -1 / q and covers every pixel. Before the pole lies the picture of a lens, beside it none.
template <class L>
Camera with_pole(double pole_tan, double residue) {
  L lens{400, 400, 319.5, 239.5, {}};
  const double q = -1 / (pole_tan * pole_tan);
  lens.d[5] = q;
  lens.d[0] = q + residue;  // residue 0: the factors cancel, and what is left is a pinhole
  return {"c", {640, 480}, lens};
}

// 400 px at a distance of 1: the corner of the picture is at the distance 1 (a pinhole's).
TEST(Validity, APoleInsideThePictureIsAFold) {
  for (const Camera& camera :
       {with_pole<OpenCV8>(0.7, 0.02), with_pole<OpenCV12>(0.7, 0.02), with_pole<OpenCV8>(0.99, 1e-4)}) {
    EXPECT_EQ(domain_fraction(camera), 1);  // every pixel has a ray, which is why unprojection sees nothing
    EXPECT_TRUE(folds_in_image(camera));
    EXPECT_LE(domain_angle_rad(camera.lens), std::atan(0.99));
  }
  for (const Camera& camera : {with_pole<OpenCV8>(1.5, 0.02), with_pole<OpenCV12>(2.0, 0.1)})
    EXPECT_FALSE(folds_in_image(camera)) << "the pole lies outside";
  Camera pincushion = with_pole<OpenCV8>(2.0, 0.1);
  params(pincushion.lens)[4] += 0.3;
  EXPECT_FALSE(folds_in_image(pincushion));
}

// Lenses at random: the walk outward in equal steps of the distance says whether it comes to the corner
// before one step takes it further than ten did.
TEST(Validity, PolesAsADenseWalkSays) {
  Rng rng(5);
  int poles = 0;
  for (int i = 0; i < 300; ++i) {
    OpenCV8 lens{400, 400, 319.5, 239.5, {}};
    lens.d[5] = -std::abs(rng.normal(1.0));
    lens.d[0] = lens.d[5] + std::abs(rng.normal(0.02));
    const auto radius_px = [&](double r) {
      return 400 * r * (1 + lens.d[0] * r * r) / (1 + lens.d[5] * r * r);
    };
    const double pole = 1 / std::sqrt(-lens.d[5]);
    double r = 1e-3;
    const auto steepness = [&](double at) {
      return (radius_px(at * (1 + 1e-6)) - radius_px(at * (1 - 1e-6))) / (2e-6 * radius_px(at));
    };
    while (r < pole && steepness(r) < 4) r += 1e-4 * pole;
    const double corner_px = std::hypot(319.5, 239.5), steep_px = radius_px(std::min(r, pole * (1 - 1e-9)));
    if (std::abs(steep_px - corner_px) < 0.02 * corner_px) continue;
    const bool by_walk = steep_px < corner_px;
    EXPECT_EQ(folds_in_image({"c", {640, 480}, lens}), by_walk) << i;
    poles += by_walk;
  }
  EXPECT_GT(poles, 50);
  EXPECT_LT(poles, 250);
}

// A picture of a whole fisheye: the image of all directions is smaller than the picture, and nothing turns.
TEST(Validity, AFisheyeThatShowsEverythingDoesNotFold) {
  EXPECT_FALSE(folds_in_image({"c", {640, 480}, KannalaBrandt4{70, 70, 319.5, 239.5, 0, 0, 0, 0}}));
  EXPECT_TRUE(folds_in_image({"c", {640, 480}, KannalaBrandt4{70, 70, 319.5, 239.5, -1.0 / 12, 0, 0, 0}}));
}

TEST(Validity, ACameraSaysNothingBeyondIt) {
  Camera camera{"c", {640, 480}, Pinhole{400, 410, 319.5, 239.5}};
  const double edge = 0.4;
  camera.validity = validity_of(camera.lens, edge);
  EXPECT_NEAR(camera.validity->radius_px, 400 * std::tan(edge), 1e-5);  // the shorter of the two axes
  for (double around = 0; around < 6.28; around += 0.3) {
    for (double factor : {0.999, 1.001}) {
      const double angle = factor * edge;
      const Vec3 p =
          3 * Vec3(std::sin(angle) * std::cos(around), std::sin(angle) * std::sin(around), std::cos(angle));
      const Vec2 px = *project(camera.lens, p);
      EXPECT_EQ(project(camera, p).has_value(), factor < 1);
      EXPECT_EQ(unproject(camera, px).has_value(), factor < 1);
    }
  }
  camera.validity.reset();
  EXPECT_EQ(domain_fraction(camera), 1);
  EXPECT_TRUE(project(camera, Vec3(2, 0, 1)));
}

TEST(Validity, TheShareOfTheImageIsThatOfTheDisc) {
  Camera camera{"c", {640, 480}, Pinhole{400, 400, 319.5, 239.5}};
  camera.validity = Validity{std::atan(0.5), 200};
  // A disc of 200 px in 640x480; the grid counts to half its spacing of 16 px along the rim of 1257 px, were
  // all of it on one side.
  EXPECT_NEAR(domain_fraction(camera), std::numbers::pi * 200 * 200 / (639.0 * 479.0), 0.03);
}

TEST(Validity, IsNoWiderThanTheDomain) {
  const KannalaBrandt4 folded{300, 300, 320, 240, -1.0 / 12, 0, 0, 0};
  const Validity v = validity_of(folded, 3.0);
  EXPECT_NEAR(v.angle_rad, 2.0, 1e-8);
  EXPECT_NEAR(v.radius_px, 300 * (2 - 8.0 / 12), 1e-3);
}

}  // namespace
}  // namespace plumbline
