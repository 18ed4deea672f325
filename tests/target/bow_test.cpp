// SPDX-License-Identifier: Apache-2.0
#include "plumbline/target/bow.hpp"

#include <gmock/gmock.h>

#include "plumbline/target/target.hpp"

namespace plumbline::test {
namespace {

// mrcal 2.2, python3: mrcal.ref_calibration_object(4, 3, 0.1, calobject_warp=np.array((1e-3, 2e-3)))[..., 2]
TEST(Bow, IsMrcalsWarpOfTheCalibrationObject) {
  const Target board = *make_target(Chessboard{4, 3, 0.1});
  const double by_mrcal[] = {0,          0.00088889, 0.00088889, 0,         0.002,     0.00288889,
                             0.00288889, 0.002,      0,          8.8889e-4, 8.8889e-4, 0};
  ASSERT_TRUE(board.outline);
  for (std::size_t i = 0; i < board.points.size(); ++i) {
    // eight decimals are printed
    EXPECT_NEAR(Vec2(1e-3, 2e-3).dot(bow_shape(*board.outline, board.points[i])), by_mrcal[i], 5e-9) << i;
  }
}

TEST(Bow, OnlyBoardsInTheirOwnPlaneHaveAnOutline) {
  EXPECT_TRUE(make_target(AprilGrid{})->outline);
  EXPECT_TRUE(make_target(Charuco{})->outline);
  EXPECT_TRUE(make_target(Circles{.asymmetric = true})->outline);
  EXPECT_FALSE(outline_of({}));
  EXPECT_FALSE(outline_of({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 1e-6}}));
  EXPECT_FALSE(outline_of({{0, 0, 0.1}, {1, 0, 0.1}, {1, 1, 0.1}, {0, 1, 0.1}}));
  EXPECT_FALSE(outline_of({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}));
}

}  // namespace
}  // namespace plumbline::test
