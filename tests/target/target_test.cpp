// SPDX-License-Identifier: Apache-2.0
#include "plumbline/target/target.hpp"

#include "support/support.hpp"

namespace plumbline {
namespace {
using ::testing::HasSubstr;

// The definition, by brute force: whether the points, turned half around their middle, fall on points again.
bool turns_onto_itself(const Target& target) {
  Vec3 low = target.points[0], high = target.points[0];
  for (const Vec3& p : target.points) low = low.cwiseMin(p), high = high.cwiseMax(p);
  for (const Vec3& p : target.points) {
    const Vec3 turned(low.x() + high.x() - p.x(), low.y() + high.y() - p.y(), p.z());
    bool found = false;
    for (const Vec3& q : target.points) found = found || (q - turned).norm() < 1e-9;
    if (!found) return false;
  }
  return true;
}

TEST(Target, CirclesAreHalfTurnSymmetricWhereTheirPointsAre) {
  for (int columns = 2; columns < 6; ++columns) {
    for (int rows = 2; rows < 12; ++rows) {
      for (bool asymmetric : {false, true}) {
        const TargetSpec spec = Circles{columns, rows, 0.02, 0.0, asymmetric};
        EXPECT_EQ(is_half_turn_symmetric(spec), turns_onto_itself(*make_target(spec)))
            << columns << "x" << rows << asymmetric;
      }
    }
  }
}

TEST(Target, AChessboardIsHalfTurnSymmetricWhereItsColoursAre) {
  // Square (c, r) of a board of n x m squares is black when c + r is even; a half turn sends it to (n-1-c,
  // m-1-r).
  for (int n = 3; n < 12; ++n) {
    for (int m = 3; m < 12; ++m) {
      const bool same_colour = (n - 1 + m - 1) % 2 == 0;
      EXPECT_EQ(is_half_turn_symmetric(Chessboard{n - 1, m - 1, 0.02}), same_colour) << n << "x" << m;
    }
  }
  EXPECT_FALSE(is_half_turn_symmetric(Charuco{}));
  EXPECT_FALSE(is_half_turn_symmetric(AprilGrid{}));
}

TEST(Target, PointsStandWhereTheHeaderSays) {
  const auto chess = make_target(Chessboard{9, 6, 0.025});
  ASSERT_TRUE(chess);
  EXPECT_EQ(chess->points.size(), 54U);
  EXPECT_LT((chess->points[9 * 2 + 3] - Vec3(0.075, 0.050, 0)).norm(), 1e-15);
  ASSERT_TRUE(chess->lattice);
  EXPECT_EQ(chess->lattice->columns, 9);

  const auto grid = make_target(AprilGrid{6, 6, 0.088, 0.3});
  ASSERT_TRUE(grid);
  EXPECT_EQ(grid->points.size(), 144U);
  // Kalibr: tag 7 is second from the left, second from the bottom; its corners run BL BR TR TL with y up.
  const double pitch = 0.088 * 1.3;
  EXPECT_LT((grid->points[28] - Vec3(pitch, pitch, 0)).norm(), 1e-15);
  EXPECT_LT((grid->points[30] - Vec3(pitch + 0.088, pitch + 0.088, 0)).norm(), 1e-15);
  EXPECT_FALSE(grid->lattice);

  const auto circles = make_target(Circles{4, 11, 0.02, 0.0, true});
  ASSERT_TRUE(circles);
  EXPECT_LT((circles->points[4 + 1] - Vec3(3 * 0.02, 0.02, 0)).norm(), 1e-15);  // OpenCV: (2 c + r % 2, r)

  const auto charuco = make_target(Charuco{});
  ASSERT_TRUE(charuco);
  EXPECT_EQ(charuco->points.size(), 70U);
}

TEST(Target, ARigIsItsBoardsOneAfterTheOtherAndNotPlanar) {
  BoardRig rig;
  rig.parts.push_back({Charuco{5, 5, 0.03, 0.022, "4X4_50", 0}, SE3()});
  Mat3 R;
  R << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  rig.parts.push_back({Charuco{5, 5, 0.03, 0.022, "4X4_50", 12}, SE3(R, Vec3(0.1, 0.2, 0.3))});
  const auto target = make_target(rig);
  ASSERT_TRUE(target) << target.error().text();
  EXPECT_EQ(target->points.size(), 32U);
  EXPECT_FALSE(target->is_planar);
  const Vec3 in_board = make_target(rig.parts[1].board)->points[5];
  EXPECT_LT((target->points[16 + 5] - (R * in_board + Vec3(0.1, 0.2, 0.3))).norm(), 1e-12);
  EXPECT_TRUE(make_target(Chessboard{})->is_planar);
}

TEST(Target, BoardsOfOneImageMustBeToldApart) {
  const auto fault = [](const TargetSpec& a, const TargetSpec& b) {
    const Status status = check_distinct({*make_target(a, "one"), *make_target(b, "two")});
    return status ? std::string() : status.error().text();
  };
  Charuco low{8, 11, 0.03, 0.022, "4X4_100"}, high = low;  // 44 markers each
  EXPECT_THAT(fault(low, high), HasSubstr("the markers 0 to 43"));
  EXPECT_THAT(fault(low, high), HasSubstr("targets one and two"));
  high.first_id = 40;
  EXPECT_THAT(fault(low, high), HasSubstr("the markers 40 to 43 (ids 0 to 43 and 40 to 83 of 4X4)"));
  EXPECT_THAT(fault(low, high), HasSubstr("first_id of its own, 44"));
  high.first_id = 44;
  EXPECT_EQ(fault(low, high), "");
  // OpenCV's dictionaries of one size of marker begin with the same codes.
  EXPECT_THAT(fault(low, Charuco{8, 11, 0.03, 0.022, "4X4_50"}), HasSubstr("the markers 0 to 43"));
  EXPECT_EQ(fault(low, Charuco{8, 11, 0.03, 0.022, "5X5_50"}), "");
  EXPECT_THAT(fault(AprilGrid{}, AprilGrid{}), HasSubstr("the markers 0 to 35"));
  EXPECT_EQ(fault(AprilGrid{}, AprilGrid{6, 6, 0.088, 0.3, "36h11", 36}), "");
  EXPECT_THAT(fault(AprilGrid{}, Charuco{8, 11, 0.03, 0.022, "APRILTAG_36h11"}), HasSubstr("0 to 35"));
  EXPECT_THAT(fault(Chessboard{9, 6, 0.02}, Chessboard{6, 9, 0.03}), HasSubstr("chessboards of 9x6"));
  EXPECT_EQ(fault(Chessboard{9, 6, 0.02}, Chessboard{8, 6, 0.02}), "");
  EXPECT_EQ(fault(Chessboard{9, 6, 0.02}, Circles{9, 6, 0.02}), "");
  BoardRig rig;
  rig.parts = {{low, SE3()}};
  EXPECT_THAT(fault(rig, low), HasSubstr("the markers 0 to 43"));
}

TEST(Target, RefusesWhatMakesNoSenseAndNamesIt) {
  const auto fault = [](const TargetSpec& spec) {
    const auto target = make_target(spec);
    return target ? std::string() : target.error().text();
  };
  EXPECT_THAT(fault(Chessboard{1, 6, 0.025}), HasSubstr("1x6"));
  EXPECT_THAT(fault(Chessboard{9, 6, -0.025}), HasSubstr("square"));
  EXPECT_THAT(fault(Chessboard{9, 6, std::nan("")}), HasSubstr("square"));
  EXPECT_THAT(fault(Chessboard{100000, 100000, 0.025}), HasSubstr("more than"));
  EXPECT_THAT(fault(Charuco{8, 11, 0.03, 0.03, "4X4_50"}), HasSubstr("smaller than its square"));
  EXPECT_THAT(fault(Charuco{8, 11, 0.03, 0.02, "4X4_51"}), HasSubstr("4X4_51"));
  EXPECT_THAT(fault(Charuco{12, 11, 0.03, 0.02, "4X4_50"}), HasSubstr("has 50"));
  EXPECT_THAT(fault(AprilGrid{6, 6, 0.088, 0.0}), HasSubstr("ratio"));
  EXPECT_THAT(fault(AprilGrid{30, 30, 0.088, 0.3}), HasSubstr("587"));
  EXPECT_THAT(fault(AprilGrid{6, 6, 0.088, 0.3, "25h9"}), HasSubstr("25h9 has 35"));
  EXPECT_EQ(fault(AprilGrid{5, 7, 0.088, 0.3, "25h9"}), "");
  EXPECT_THAT(fault(AprilGrid{2, 2, 0.088, 0.3, "16h5"}), HasSubstr("36h11, 25h9"));
  EXPECT_THAT(fault(AprilGrid{6, 6, 0.088, 0.3, "36h11", 0, 3}), HasSubstr("border of 3"));
  EXPECT_THAT(fault(Circles{4, 11, 0.02, 0.03, true}), HasSubstr("touch"));
  EXPECT_THAT(fault(Points3d{{Vec3::Zero(), Vec3::Ones()}}), HasSubstr("at least 4"));
  BoardRig rig;
  EXPECT_THAT(fault(rig), HasSubstr("at least one part"));
  rig.parts.assign(2, {Charuco{}, SE3()});
  EXPECT_THAT(fault(rig), HasSubstr("first_id"));
  rig.parts.assign(1, {Chessboard{}, SE3()});
  EXPECT_THAT(fault(rig), HasSubstr("told apart"));
}

TEST(Target, DictionariesAreOpenCVs) {
  EXPECT_EQ(dictionary_size("4X4_50"), 50);
  EXPECT_EQ(dictionary_size("7X7_1000"), 1000);
  EXPECT_EQ(dictionary_size("APRILTAG_36h11"), 587);
  EXPECT_EQ(dictionary_size("8X8_50"), std::nullopt);
  EXPECT_EQ(dictionary_size(""), std::nullopt);
}

}  // namespace
}  // namespace plumbline
