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
