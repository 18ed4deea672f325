// SPDX-License-Identifier: Apache-2.0
#include "detect/chess_search.hpp"

#include <opencv2/imgproc.hpp>

#include "detect/chess_ends.hpp"
#include "detect/chess_fit.hpp"
#include "detect/render.hpp"
#include "plumbline/detect/detect.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

/// A board photographed so that a part of it is outside of the image on the right.
struct Photograph {
  Target target;
  PlaneCamera camera;
  cv::Mat image;
};

Photograph photograph(const Chessboard& board, double shift_px) {
  Photograph out{*make_target(board), {}, {}};
  out.camera = look_at(out.target, 12, -8, 10, 1.5);
  out.camera.centre.x() += shift_px;
  Render how;
  how.noise = 2;
  out.image = render(out.camera, chessboard_shade(board), how);
  return out;
}

Detection found(const Photograph& p) { return *detect_target(p.image, p.target); }

// A board with ends of two colours tells which of its corners are in the image.
TEST(ChessSearch, PartOfABoardHasItsIds) {
  for (const double shift : {160.0, 260.0, -240.0}) {
    const Photograph p = photograph({10, 7, 0.03}, shift);
    int visible = 0;
    for (const Vec3& point : p.target.points) {
      const Vec2 px = p.camera.px_of(point);
      visible += px.x() > 3 && px.x() < 636 && px.y() > 3 && px.y() < 476 ? 1 : 0;
    }
    const Accuracy a = accuracy(found(p), p.target, p.camera);
    EXPECT_LT(visible, 70);
    EXPECT_GE(a.found, visible - 1) << shift;  // one may lie too near to the border
    EXPECT_LT(a.worst, 0.1) << shift;          // and none has another's id
  }
}

// A board that looks the same after a half turn does not tell, so a part of it has no ids.
TEST(ChessSearch, PartOfASymmetricBoardHasNone) {
  const Photograph p = photograph({10, 8, 0.03}, 260);
  const Detection d = found(p);
  EXPECT_TRUE(d.corners.empty());
  EXPECT_THAT(d.reason, testing::HasSubstr("nothing tells which"));
}

// A smaller board whose ends are in the image is not a part of the larger one.
TEST(ChessSearch, AnotherBoardIsNone) {
  for (const Chessboard& other : {Chessboard{6, 5, 0.03}, Chessboard{9, 7, 0.03}, Chessboard{11, 8, 0.03}}) {
    Photograph p = photograph(other, 0);
    p.target = *make_target(Chessboard{10, 7, 0.03});
    EXPECT_TRUE(found(p).corners.empty()) << other.columns << "x" << other.rows;
  }
}

// Two boards of the same counts: whichever was meant, the other one would be wrong.
TEST(ChessSearch, TwoBoardsAreNone) {
  Photograph left = photograph({10, 7, 0.03}, 0), right = left;
  left.camera.centre.x() -= 20, right.camera.centre.x() += 30;
  cv::Mat both;
  Render how;
  how.noise = 2;
  cv::hconcat(render(left.camera, chessboard_shade({10, 7, 0.03}), how),
              render(right.camera, chessboard_shade({10, 7, 0.03}), how), both);
  const Detection d = *detect_target(both, left.target);
  EXPECT_TRUE(d.corners.empty());
  EXPECT_THAT(d.reason, testing::HasSubstr("two 10x7 chessboards"));
  // Boards of different counts are told apart.
  const Chessboard other{8, 5, 0.03};
  const Photograph p = photograph(other, 0);
  cv::hconcat(left.image, p.image, both);
  EXPECT_EQ(detect_target(both, left.target)->corners.size(), 70U);
  EXPECT_EQ(detect_target(both, p.target)->corners.size(), 40U);
}

// Rows that grew into the surroundings vanish in the fit, and with them what they said about the ids.
TEST(ChessSearch, RimsHaveToStay) {
  detail::ChessGrid before(4, 4), after(4, 4);
  for (std::size_t i = 0; i < 12; ++i) before.px[i] = after.px[i] = Vec2(0, 0);
  EXPECT_TRUE(detail::has_kept_its_rims(before, after));
  before.px[13] = Vec2(0, 0);  // one of a row that was not there before
  EXPECT_FALSE(detail::has_kept_its_rims(before, after));
  after.px[13] = Vec2(0, 0);
  EXPECT_TRUE(detail::has_kept_its_rims(before, after));
  after.px[4] = std::nullopt;  // one of a column that stays
  EXPECT_TRUE(detail::has_kept_its_rims(before, after));
}

// The corners of a 10x7 board are searched for around a part of them, and around all.
TEST(ChessSearch, PartsGoOn) {
  const Photograph p = photograph({10, 7, 0.03}, 0);
  for (const auto& [c0, r0, columns, rows] :
       {std::array{0, 0, 10, 7}, {1, 0, 9, 7}, {0, 0, 9, 7}, {0, 1, 10, 6}, {0, 0, 10, 6}}) {
    detail::ChessGrid grid(columns, rows);
    for (int r = 0; r < rows; ++r) {
      for (int c = 0; c < columns; ++c)
        grid.at(c, r) = p.camera.px_of(p.target.points[static_cast<std::size_t>((r + r0) * 10 + c + c0)]);
    }
    const auto corners = detail::refine_grid(p.image, grid, 1, 2);
    EXPECT_EQ(detail::goes_on(p.image, grid, corners, 2), columns * rows < 70) << c0 << r0 << columns << rows;
  }
}

// Seen at 60 degrees, dark, and with squares of 10 px.
TEST(ChessSearch, HardViews) {
  const Chessboard board{10, 7, 0.03};
  const Target target = *make_target(board);
  for (const auto& [yaw, distance] : {std::pair{60.0, 1.4}, {0.0, 4.5}}) {
    const PlaneCamera camera = look_at(target, 5, yaw, 8, distance);
    Render how;
    how.noise = 2, how.black = 20, how.white = 75;
    const Detection d = *detect_target(render(camera, chessboard_shade(board), how), target);
    const Accuracy a = accuracy(d, target, camera);
    EXPECT_EQ(a.found, 70) << yaw << " " << d.reason;
    EXPECT_LT(a.worst, 0.3) << yaw;
  }
}

}  // namespace
}  // namespace plumbline::test
