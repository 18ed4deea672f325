// SPDX-License-Identifier: Apache-2.0
#include "plumbline/synth/board.hpp"

#include <apriltag/apriltag.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h11.h>

#include <cstdlib>
#include <opencv2/aruco/charuco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "support/support.hpp"

namespace plumbline {
namespace {

BoardDrawing drawing_of(const TargetSpec& spec) { return draw_target(*make_target(spec)).value().at(0); }

// Grey levels of the drawing sampled at the centres of cells of `cell_m`, from its top left as it is seen.
cv::Mat1b sample(const BoardDrawing& d, double cell_m) {
  const Vec2 size = d.size();
  cv::Mat1b image(static_cast<int>(std::lround(size.y() / cell_m)),
                  static_cast<int>(std::lround(size.x() / cell_m)));
  for (int r = 0; r < image.rows; ++r) {
    for (int c = 0; c < image.cols; ++c) {
      const double x = d.low.x() + (c + 0.5) * cell_m;
      const double y = d.y_up ? d.high.y() - (r + 0.5) * cell_m : d.low.y() + (r + 0.5) * cell_m;
      image(r, c) = is_black(d, {x, y}) ? 0 : 255;
    }
  }
  return image;
}

int n_different(const cv::Mat& a, const cv::Mat& b) {
  EXPECT_EQ(a.size(), b.size());
  return a.size() == b.size() ? cv::countNonZero(a != b) : -1;
}

TEST(Board, ChessboardChangesColourAtEachPoint) {
  const Target target = *make_target(Chessboard{9, 6, 0.025});
  const BoardDrawing d = drawing_of(target.spec);
  EXPECT_TRUE(is_black(d, {-0.001, -0.001}));  // the top-left square is black
  for (const Vec3& p : target.points) {
    const auto black = [&](double dx, double dy) { return is_black(d, p.head<2>() + 1e-4 * Vec2(dx, dy)); };
    EXPECT_EQ(black(1, 1), black(-1, -1));
    EXPECT_EQ(black(1, -1), black(-1, 1));
    EXPECT_NE(black(1, 1), black(1, -1));
  }
  EXPECT_TRUE(d.size().isApprox(*pattern_size_m(target.spec), 1e-12));
}

// OpenCV 4.6 draws the current layout; margins and borders are chosen so that every module is a whole number
// of pixels.
TEST(Board, CharucoIsOpenCvsOwnDrawing) {
  struct Case {
    int columns, rows;
    const char* dictionary;
    int number, modules;
  };
  for (const Case& k :
       {Case{5, 7, "4X4_50", cv::aruco::DICT_4X4_50, 6}, Case{8, 6, "5X5_100", cv::aruco::DICT_5X5_100, 7},
        Case{4, 4, "APRILTAG_36h11", cv::aruco::DICT_APRILTAG_36h11, 8},
        Case{7, 9, "6X6_250", cv::aruco::DICT_6X6_250, 8}}) {
    const int marker_px = 10 * k.modules, square_px = marker_px + 20;
    const auto board = cv::aruco::CharucoBoard::create(k.columns, k.rows, static_cast<float>(square_px),
                                                       static_cast<float>(marker_px),
                                                       cv::aruco::getPredefinedDictionary(k.number));
    cv::Mat theirs;
    board->draw(cv::Size(k.columns * square_px, k.rows * square_px), theirs, 0, 1);
    const BoardDrawing d =
        drawing_of(Charuco{k.columns, k.rows, 1e-3 * square_px, 1e-3 * marker_px, k.dictionary, 0});
    EXPECT_EQ(n_different(sample(d, 1e-3), theirs), 0) << k.dictionary;
  }
}

TEST(Board, CharucoFirstIdAndLegacyLayout) {
  const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_4X4_50);
  const auto marker_at = [&](const BoardDrawing& d, int column, int row) {
    const cv::Mat image = sample(d, 1e-3);
    return cv::Mat(image(cv::Rect(80 * column + 10, 80 * row + 10, 60, 60)));
  };
  const auto expected = [&](int id) {
    cv::Mat image;
    dictionary->drawMarker(id, 60, image, 1);
    return image;
  };
  const Charuco current{4, 6, 0.08, 0.06, "4X4_50", 7};
  EXPECT_EQ(n_different(marker_at(drawing_of(current), 1, 0), expected(7)), 0);
  Charuco legacy = current;
  legacy.layout = Charuco::Layout::kLegacy;
  // Before OpenCV 4.6 a board with an even number of rows began with a marker, counted row by row all the
  // same.
  EXPECT_EQ(n_different(marker_at(drawing_of(legacy), 0, 0), expected(7)), 0);
  EXPECT_EQ(n_different(marker_at(drawing_of(legacy), 1, 1), expected(9)), 0);
  // With an odd number of rows the two layouts are one.
  Charuco odd{4, 5, 0.08, 0.06, "4X4_50", 0}, odd_legacy = odd;
  odd_legacy.layout = Charuco::Layout::kLegacy;
  EXPECT_EQ(n_different(sample(drawing_of(odd), 1e-3), sample(drawing_of(odd_legacy), 1e-3)), 0);
}

TEST(Board, AprilGridTagsAreAprilTagsOwnWithABorderOfOneOrTwoModules) {
  const double tag_m = 0.1;
  for (const std::string name : {"36h11", "25h9"}) {
    apriltag_family_t* family = name == "25h9" ? tag25h9_create() : tag36h11_create();
    for (const int border : {1, 2}) {
      const AprilGrid grid{3, 2, tag_m, 0.3, name, 4, border};
      const BoardDrawing d = drawing_of(grid);
      const Target target = *make_target(grid);
      for (int t = 0; t < 6; ++t) {
        // With a white rim and a border of one module around the code.
        image_u8_t* theirs = apriltag_to_image(family, static_cast<std::uint32_t>(4 + t));
        const int inner = theirs->width - 4, n = inner + 2 * border;
        ASSERT_EQ(inner, name == "25h9" ? 5 : 6);
        const Vec2 bottom_left = target.points[4 * t].head<2>(),
                   top_right = target.points[4 * t + 2].head<2>();
        for (int r = 0; r < n; ++r) {
          for (int c = 0; c < n; ++c) {
            const int y = r - border, x = c - border;
            const bool is_code = y >= 0 && x >= 0 && y < inner && x < inner;
            // Kalibr scales the tag so that all modules fill it.
            const bool white = is_code && theirs->buf[(y + 2) * theirs->stride + x + 2] != 0;
            const Vec2 p(bottom_left.x() + (c + 0.5) * tag_m / n, top_right.y() - (r + 0.5) * tag_m / n);
            EXPECT_EQ(is_black(d, p), !white) << name << " " << t << " " << r << " " << c;
          }
        }
        std::free(theirs->buf);  // image_u8_destroy is not exported by every build of the library
        std::free(theirs);
      }
    }
    name == "25h9" ? tag25h9_destroy(family) : tag36h11_destroy(family);
  }
}

TEST(Board, AprilGridHasBlackSquaresWhereTagsMeet) {
  const AprilGrid grid{3, 2, 0.1, 0.3, "36h11", 0};
  const BoardDrawing d = drawing_of(grid);
  EXPECT_TRUE(d.size().isApprox(*pattern_size_m(grid), 1e-12));
  const Target target = *make_target(grid);
  for (const Vec3& p : target.points) {
    // Two black and two white quarters around each point: the tag and the square opposite to it.
    const auto black = [&](double dx, double dy) { return is_black(d, p.head<2>() + 1e-3 * Vec2(dx, dy)); };
    EXPECT_EQ(black(1, 1) + black(-1, -1) + black(1, -1) + black(-1, 1), 2);
    EXPECT_EQ(black(1, 1), black(-1, -1));
  }
}

// The board that EuRoC's authors printed with Kalibr, seen through their published lens: the centres of the
// tags that OpenCV finds fix a homography, and the modules of all 36 tags must then have the colours of our
// drawing.
TEST(Board, AprilGridIsTheBoardOfAPhotograph) {
  const auto dir = test::data_dir("aprilgrid_rs");
  PLUMBLINE_NEEDS(dir);
  const cv::Mat photograph = cv::imread((*dir / "tests/data/EuRoC.png").string(), cv::IMREAD_GRAYSCALE);
  ASSERT_FALSE(photograph.empty());
  const AprilGrid grid{6, 6, 0.088, 0.3, "36h11", 0};
  const Target target = *make_target(grid);
  std::vector<std::vector<cv::Point2f>> tags;
  std::vector<int> ids;
  const auto options = cv::aruco::DetectorParameters::create();
  options->markerBorderBits = 2;
  cv::aruco::detectMarkers(photograph, cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11),
                           tags, ids, options);
  ASSERT_GE(ids.size(), 8u);
  const cv::Matx33d K(458.654, 0, 367.215, 0, 457.296, 248.375, 0, 0, 1);
  const cv::Vec4d D(-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05);
  std::vector<cv::Point2f> board, seen;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const Vec3 centre = 0.5 * (target.points.at(4 * ids[i]) + target.points.at(4 * ids[i] + 2));
    board.emplace_back(static_cast<float>(centre.x()), static_cast<float>(centre.y()));
    seen.push_back(0.25f * (tags[i][0] + tags[i][1] + tags[i][2] + tags[i][3]));
  }
  cv::undistortPoints(seen, seen, K, D);
  const cv::Matx33d H = cv::findHomography(board, seen);
  const BoardDrawing d = drawing_of(grid);
  int n_same = 0;
  for (int t = 0; t < 36; ++t) {
    for (int m = 0; m < 36; ++m) {
      const Vec3 p = target.points[4 * t] + 0.0088 * Vec3(2.5 + m % 6, 2.5 + m / 6, 0);
      const cv::Vec3d q = H * cv::Vec3d(p.x(), p.y(), 1);
      std::vector<cv::Point2d> px;
      cv::projectPoints(std::vector<cv::Point3d>{{q[0] / q[2], q[1] / q[2], 1}}, cv::Vec3d(), cv::Vec3d(), K,
                        D, px);
      const int grey = photograph.at<unsigned char>(static_cast<int>(std::lround(px[0].y)),
                                                    static_cast<int>(std::lround(px[0].x)));
      n_same += (grey < 140) == is_black(d, p.head<2>());
    }
  }
  // A module is 3 px wide, so some are misread; a wrong turn, mirror or order of ids gives one half.
  EXPECT_GT(n_same, 1200) << n_same << " of 1296";
}

TEST(Board, CirclesStandAtThePoints) {
  for (const Circles& spec :
       {Circles{9, 7, 0.02}, Circles{4, 11, 0.018, 0, true}, Circles{4, 5, 0.02, 0.013}}) {
    const Target target = *make_target(spec);
    const BoardDrawing d = drawing_of(spec);
    ASSERT_EQ(d.discs.size(), target.points.size());
    for (std::size_t i = 0; i < d.discs.size(); ++i)
      EXPECT_TRUE(d.discs[i].centre.isApprox(target.points[i].head<2>(), 1e-12));
    EXPECT_TRUE(d.size().isApprox(*pattern_size_m(spec), 1e-12));
  }
}

TEST(Board, ARigGivesOneDrawingPerPartAndFreePointsNone) {
  const SE3 T = se3_exp((Vec6() << 0.1, 0.2, 0.3, 1, 2, 3).finished());
  const auto target = make_target(BoardRig{
      {{Charuco{5, 5, 0.03, 0.022, "4X4_50", 0}, SE3()}, {Charuco{5, 5, 0.03, 0.022, "4X4_50", 12}, T}}});
  ASSERT_TRUE(target) << target.error().text();
  const auto drawings = draw_target(*target);
  ASSERT_TRUE(drawings);
  ASSERT_EQ(drawings->size(), 2u);
  EXPECT_EQ(drawings->at(1).T_target_board, T);
  const auto none = draw_target(*make_target(Points3d{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}));
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::kUnsupported);
}

// Few shapes keep files small: a chessboard of 10x7 squares is its 35 black squares, a tag its merged runs.
TEST(Board, RunsOfModulesAreMerged) {
  EXPECT_EQ(drawing_of(Chessboard{9, 6, 0.025}).boxes.size(), 35u);
  EXPECT_LT(drawing_of(AprilGrid{6, 6, 0.088, 0.3}).boxes.size(), 49u + 36u * 25u);
}

}  // namespace
}  // namespace plumbline
