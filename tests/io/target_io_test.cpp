// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/target_io.hpp"

#include <gmock/gmock.h>

#include <numbers>

#include "plumbline/geometry/so3.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
using ::testing::HasSubstr;

std::string error_of(const std::string& yaml) {
  const auto target = parse_target(yaml);
  return target ? "no error" : target.error().text();
}

TEST(TargetIo, ReadsEachTypeOfOurs) {
  EXPECT_EQ(parse_target("type: chessboard\ncorners: [9, 6]\nsquare_m: 0.025\n")->spec,
            TargetSpec(Chessboard{9, 6, 0.025}));
  const Charuco charuco{8, 11, 0.03, 0.022, "4X4_50", 2, Charuco::Layout::kLegacy};
  EXPECT_EQ(
      parse_target("type: charuco\nsquares: [8, 11]\nsquare_m: 0.03\nmarker_m: 0.022\ndictionary: 4X4_50\n"
                   "first_id: 2\nlayout: legacy\n")
          ->spec,
      TargetSpec(charuco));
  const AprilGrid april{6, 5, 0.088, 0.3, "36h11", 7};
  EXPECT_EQ(
      parse_target("{type: aprilgrid, tags: [6, 5], tag_m: 0.088, spacing: 0.3, family: 36h11, first_id: 7}")
          ->spec,
      TargetSpec(april));
  EXPECT_EQ(
      parse_target("{type: aprilgrid, tags: [5, 4], tag_m: 0.1, spacing: 0.25, family: 25h9, border: 1}")
          ->spec,
      TargetSpec(AprilGrid{5, 4, 0.1, 0.25, "25h9", 0, 1}));
  EXPECT_FALSE(parse_target("{type: aprilgrid, tags: [5, 4], tag_m: 0.1, spacing: 0.25, border: 0}"));
  EXPECT_EQ(
      parse_target("type: circles\ncircles: [4, 11]\nspacing_m: 0.02\ndiameter_m: 0.01\nasymmetric: true\n")
          ->spec,
      TargetSpec(Circles{4, 11, 0.02, 0.01, true}));
  const auto points =
      parse_target("type: points\npoints_m: [[0, 0, 0], [1, 0, 0],\n  [0, 1, 0], [0.5, 0.25, 2e-1]]\n");
  EXPECT_EQ(points->points.at(3), Vec3(0.5, 0.25, 0.2));
  EXPECT_FALSE(points->is_planar);
}

TEST(TargetIo, ReadsARigOfBoardsWithRotationVectors) {
  const auto target = parse_target(
      "name: cube\n"
      "type: rig\n"
      "parts:\n"
      "  - board: {type: charuco, squares: [4, 4], square_m: 0.1, marker_m: 0.07, dictionary: 4X4_50}\n"
      "    pose: {rotation_rad: [0, 0, 0], translation_m: [0, 0, 0]}\n"
      "  - board: {type: charuco, squares: [4, 4], square_m: 0.1, marker_m: 0.07, dictionary: 4X4_50, "
      "first_id: 8}\n"
      "    pose: {rotation_rad: [0, 1.5707963267948966, 0], translation_m: [0.5, 0, 0]}\n");
  ASSERT_TRUE(target) << target.error().text();
  EXPECT_EQ(target->name, "cube");
  ASSERT_EQ(target->points.size(), 18u);
  // Point 1 of the second board is (0.1, 0, 0); a quarter turn about y takes x to -z.
  EXPECT_NEAR((target->points[10] - Vec3(0.5, 0, -0.1)).norm(), 0, 1e-15);
}

TEST(TargetIo, GivesEverySpecBackToTheLastBit) {
  const Charuco one{5, 7, 0.03, 0.022, "6X6_250", 17, Charuco::Layout::kCurrent};
  BoardRig rig;
  rig.parts.push_back({one, SE3(so3_exp({0.1, -0.7, 0.3}), {1.0 / 3, 0.1, -2e-7})});
  rig.parts.push_back(
      {AprilGrid{3, 4, 0.05, 0.25, "36h11", 30}, SE3(so3_exp({-3, 0.2, 0.1}), {0.3, 0, 1e-3})});
  for (const TargetSpec& spec :
       {TargetSpec(Chessboard{7, 5, 1.0 / 30}), TargetSpec(one), TargetSpec(AprilGrid{}),
        TargetSpec(AprilGrid{5, 4, 0.1, 0.3, "25h9", 2, 1}), TargetSpec(Circles{4, 11, 0.02, 0, true}),
        TargetSpec(Circles{4, 5, 0.02, 0.013, false}),
        TargetSpec(Points3d{{{0, 0, 0}, {0.1, 0, 0}, {1.0 / 3, 2.0 / 3, 0}, {0, 0.7, 1e-17}}}),
        TargetSpec(rig)}) {
    const Target target = make_target(spec, "a name: with \"quotes\" # and \n more").value();
    const std::string yaml = format_target(target);
    const auto back = parse_target(yaml);
    ASSERT_TRUE(back) << back.error().text() << "\n" << yaml;
    EXPECT_EQ(back->spec, spec) << yaml;
    EXPECT_EQ(back->name, target.name);
    EXPECT_EQ(format_target(*back), yaml);
  }
}

TEST(TargetIo, ReadsKalibrsFilesAsTheyAre) {
  const auto april = parse_target(
      "target_type: 'aprilgrid' #gridtype\ntagCols: 6               #number of apriltags\ntagRows: 5\n"
      "tagSize: 0.088           #size of apriltag, edge to edge [m]\ntagSpacing: 0.3          #ratio of "
      "space between tags to tagSize\n");
  EXPECT_EQ(april->spec, TargetSpec(AprilGrid{6, 5, 0.088, 0.3, "36h11", 0}));
  EXPECT_EQ(parse_target("target_type: 'checkerboard'\ntargetCols: 6\ntargetRows: 7\nrowSpacingMeters: "
                         "0.06\ncolSpacingMeters: 0.06\n")
                ->spec,
            TargetSpec(Chessboard{6, 7, 0.06}));
  EXPECT_EQ(parse_target("target_type: circlegrid\ntargetCols: 6\ntargetRows: 7\nspacingMeters: "
                         "0.02\nasymmetricGrid: False\n")
                ->spec,
            TargetSpec(Circles{6, 7, 0.02, 0, false}));
}

TEST(TargetIo, KalibrsFirstTagIsReadAndItsOtherKeysArePassedOver) {
  const auto april = parse_target(
      "#subset of the board\ntarget_type: 'aprilgrid'\ntagCols: 6\ntagRows: 5\ntagSize: 0.088\ntagSpacing: "
      "0.3\ncodeOffset: 40 #first tag\nsubset: {a: [1]}\n");
  ASSERT_TRUE(april) << april.error().text();
  EXPECT_EQ(april->spec, TargetSpec(AprilGrid{6, 5, 0.088, 0.3, "36h11", 40}));
  EXPECT_TRUE(
      parse_target("{target_type: checkerboard, targetCols: 6, targetRows: 7, rowSpacingMeters: 0.06, "
                   "colSpacingMeters: 0.06, note: x}"));
  EXPECT_THAT(error_of("target_type: aprilgrid\ntagCols: 6\ntagRows: 5\ntagSize: 0.088\ntagSpacing: "
                       "0.3\ncodeOffset: -1\n"),
              HasSubstr("codeOffset, line 6: -1 is not within"));
  // A key that was misspelt is not passed over in silence.
  EXPECT_THAT(error_of("{target_type: circlegrid, targetCols: 6, targetRows: 7, spacingMeters: 0.02, "
                       "asymetricGrid: true}"),
              HasSubstr("'asymmetricGrid' is missing"));
  EXPECT_THAT(error_of("{type: aprilgrid, tags: [6, 5], tag_m: 0.088, spacing: 0.3, codeOffset: 1}"),
              HasSubstr("unknown key 'codeOffset'"));
}

// Kalibr's GridCalibrationTargetCirclegrid puts circle (r, c) of an asymmetric grid at ((2 c + r % 2) s, r
// s): the neighbour in the row is 2 s away, and the first circle of the second row is at (s, s).
TEST(TargetIo, KalibrsAsymmetricSpacingIsHalfARowsPitch) {
  const auto target = parse_target(
      "{target_type: circlegrid, targetCols: 4, targetRows: 11, spacingMeters: 0.02, asymmetricGrid: true}");
  EXPECT_EQ(target->points[1], Vec3(0.04, 0, 0));
  EXPECT_EQ(target->points[4], Vec3(0.02, 0.02, 0));
}

TEST(TargetIo, NamesTheFieldTheLineAndTheNextStep) {
  EXPECT_THAT(error_of("type: chessboard\ncorners: [9, 6]\nsqare_m: 0.025\n"),
              HasSubstr("sqare_m, line 3: unknown key 'sqare_m'; did you mean 'square_m'? [kParse]"));
  EXPECT_THAT(error_of("type: chessboard\ncorners: [9, 6, 3]\nsquare_m: 0.025\n"),
              HasSubstr("corners, line 2: two numbers"));
  EXPECT_THAT(error_of("type: chessboard\ncorners: [9, 6.5]\nsquare_m: 0.025\n"),
              HasSubstr("corners[1], line 2: a whole number is needed, not '6.5'"));
  EXPECT_THAT(error_of("type: chessboard\ncorners: [9, 6]\nsquare_m: .nan\n"),
              HasSubstr("square_m, line 3: a finite number"));
  EXPECT_THAT(error_of("type: chessboard\ncorners: [9, 6]\n"), HasSubstr("'square_m' is missing"));
  EXPECT_THAT(error_of("type: chesboard\n"), HasSubstr("known are: chessboard, charuco"));
  EXPECT_THAT(error_of("type: chessboard\ntype: circles\n"),
              HasSubstr("line 2: the key 'type' is there twice"));
  EXPECT_THAT(error_of("type: rig\nparts:\n  - board: {type: chessboard, corners: [4, 4], square_m: 1}\n    "
                       "pose: {rotation_rad: [0, 0], translation_m: [0, 0, 0]}\n"),
              HasSubstr("parts[0].pose.rotation_rad, line 4: 3 numbers are needed, there are 2"));
  EXPECT_THAT(error_of("type: rig\nparts:\n  - board: {type: chessboard, corners: [4, 4], square_m: 1}\n    "
                       "pose: {translation_m: [0, 0, 0], rotation_rad: [0, 180, 0]}\n"),
              HasSubstr("are these degrees?"));
  EXPECT_THAT(error_of("type: chessboard\ncorners: [1, 6]\nsquare_m: 0.1\n"),
              HasSubstr("at least 2 columns"));
  EXPECT_THAT(error_of("target_type: checkerboard\ntargetCols: 6\ntargetRows: 7\nrowSpacingMeters: "
                       "0.06\ncolSpacingMeters: 0.05\n"),
              HasSubstr("[kUnsupported]"));
  EXPECT_THAT(error_of("width: 3\n"), HasSubstr("not a target"));
  EXPECT_THAT(error_of("[1, 2]"), HasSubstr("a map"));
  EXPECT_THAT(error_of(""), HasSubstr("empty"));
}

}  // namespace
}  // namespace plumbline
