// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/bundle_structure.hpp"

#include <gmock/gmock.h>

#include "bundle_scenes.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;
using Kind = BundleStructure::Kind;

Reconstruction small_scene() {
  Reconstruction scene =
      make_scene({.n_views = 5, .n_points = 12, .lenses = {"pinhole", "opencv5"}, .seen = 0.8});
  return scene;
}

BundleOptions small_options(const Reconstruction& scene) {
  return {.hold_views = {1},
          .scale_bars = {{3, 8, (scene.p_world[3] - scene.p_world[8]).norm(), 1e-3}},
          .free_intrinsics = {"camera2 fx", "camera2 fy"}};
}

TEST(BundleStructure, SaysWhatDependsOnWhat) {
  const Reconstruction scene = small_scene();
  const auto structure = bundle_structure(scene, small_options(scene));
  ASSERT_TRUE(structure) << structure.error().text();
  ASSERT_EQ(structure->columns.size(),
            1u + 4u + 12u);  // a lens of two steps, views without the held one, points
  EXPECT_EQ(structure->columns[0].kind, Kind::kLens);
  EXPECT_EQ(structure->columns[0].index, 1);
  EXPECT_EQ(structure->columns[0].size, 2);
  EXPECT_EQ(structure->columns[2].index, 2);  // view 1 is held
  ASSERT_EQ(structure->rows.size(), scene.sightings.size() + 1);
  EXPECT_EQ(structure->row_size.back(), 1);
  EXPECT_EQ(structure->rows.back(), (std::vector<int>{5 + 3, 5 + 8}));
  EXPECT_THAT(bundle_structure(scene, {.hold_views = {1}}).error().text(), HasSubstr("free in 1 of 7"));
  EXPECT_EQ(bundle_structure(scene).value().columns.size(), 5u - 1u + 12u);
}

// The picture of J'J against J'J itself, from the derivatives of predict() by differences.
TEST(BundleStructure, ThePictureShowsWhereTheNumbersAre) {
  const Reconstruction scene = small_scene();
  const BundleOptions options = small_options(scene);
  const BundleStructure s = bundle_structure(scene, options).value();
  int n = 0;
  for (const auto& column : s.columns) n += column.size;
  const double h = 1e-5;
  const auto residuals = [&](const Reconstruction& at) {
    VecX r(2 * static_cast<Eigen::Index>(at.sightings.size()) + 1);
    for (std::size_t i = 0; i < at.sightings.size(); ++i)
      r.segment<2>(2 * static_cast<Eigen::Index>(i)) = *predict(at, at.sightings[i]);
    r[r.size() - 1] = (at.p_world[3] - at.p_world[8]).norm();
    return r;
  };
  MatX J(residuals(scene).size(), n);
  int next = 0;
  for (const auto& column : s.columns) {
    for (int i = 0; i < column.size; ++i) {
      Reconstruction moved = scene;
      if (column.kind == Kind::kLens) params(moved.cameras[column.index].lens)[i] += h;
      if (column.kind == Kind::kView)
        moved.views[column.index].T_cam_world =
            box_plus(moved.views[column.index].T_cam_world, h * Vec6::Unit(i));
      if (column.kind == Kind::kPoint) moved.p_world[column.index][i] += h;
      J.col(next++) = (residuals(moved) - residuals(scene)) / h;
    }
  }
  const StructureImage picture = draw_normal_matrix(s, 1000), of_J = draw_jacobian(s, 10000);
  ASSERT_EQ(picture.width, n);
  ASSERT_EQ(picture.height, n);
  const MatX N = J.transpose() * J;
  // By blocks, because single numbers in a block may be zero by chance (fy and x).
  int row = 0;
  for (const auto& a : s.columns) {
    int col = 0;
    for (const auto& b : s.columns) {
      const bool there = N.block(row, col, a.size, b.size).cwiseAbs().maxCoeff() > 1e-6;
      for (int i = 0; i < a.size; ++i) {
        for (int j = 0; j < b.size; ++j) {
          const int value = picture.pixels[static_cast<std::size_t>((row + i) * n + col + j)];
          EXPECT_EQ(value != 0, there) << row + i << " " << col + j;
          if (there) EXPECT_EQ(value, a.kind == b.kind ? 1 + static_cast<int>(a.kind) : 4);
        }
      }
      col += b.size;
    }
    row += a.size;
  }
  ASSERT_EQ(of_J.width, n);
  ASSERT_EQ(of_J.height, J.rows());
  long filled = 0;
  for (std::uint8_t pixel : of_J.pixels) filled += pixel != 0;
  long expected = 6;  // the bar
  for (const Sighting& sighting : scene.sightings)
    expected += 2 * (3 + (sighting.view == 1 ? 0 : 6) + (scene.views[sighting.view].camera == 1 ? 2 : 0));
  EXPECT_EQ(filled, expected);
}

TEST(BundleStructure, LargeProblemsAreDrawnSmall) {
  const BundleStructure s = bundle_structure(make_scene({.n_points = 400, .seen = 0.4})).value();
  const StructureImage J = draw_jacobian(s, 300), N = draw_normal_matrix(s, 300);
  EXPECT_LE(std::max({J.width, J.height, N.width, N.height}), 300);
  EXPECT_GE(std::min(N.width, N.height), 299);
  for (int i = 0; i < N.width; ++i) EXPECT_NE(N.pixels[static_cast<std::size_t>(i) * N.width + i], 0) << i;
  const std::string svg = format_structure_svg(s, 300);
  EXPECT_THAT(svg, HasSubstr("<svg "));
  EXPECT_THAT(svg, HasSubstr("19 views"));
  EXPECT_LT(svg.size(), 2'000'000u);
  EXPECT_EQ(svg, format_structure_svg(s, 300));
}

}  // namespace
}  // namespace plumbline::test
