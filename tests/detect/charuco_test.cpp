// SPDX-License-Identifier: Apache-2.0
// ChArUco boards as they are in photographs: blurred, cut off, under glare, other ones. Ids are judged
// against the rendered truth: a corner with another's id is many pixels from it.
#include "detect/charuco.hpp"

#include <opencv2/imgproc.hpp>

#include "detect/render.hpp"
#include "plumbline/detect/detect.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

constexpr double kOwnPx = 1;  ///< nearer than this to the truth of its id: squares are 30 px and more

Charuco small_board() { return {8, 6, 0.03, 0.022, "4X4_50"}; }

Detection found(const cv::Mat& image, const Target& target) {
  const auto result = detect_target(image, target);
  EXPECT_TRUE(result);
  return result ? *result : Detection{};
}

/// As render(), with less to do: ids are what is asked for here.
cv::Mat shown(const PlaneCamera& camera, const Shade& shade) {
  Render how;
  how.samples = 3;
  return render(camera, shade, how);
}

/// Corners in the image by 3 px.
int visible(const Target& target, const PlaneCamera& camera) {
  int n = 0;
  for (const Vec3& p : target.points) {
    const Vec2 px = camera.px_of(p);
    n += px.x() > 3 && px.y() > 3 && px.x() < camera.size.width - 4 && px.y() < camera.size.height - 4;
  }
  return n;
}

// A blur of 3 px on modules of 5 px leaves no module its own grey level.
TEST(Charuco, BlurredBoardIsWhole) {
  const Charuco board{11, 8, 0.03, 0.022, "5X5_100"};
  const Target target = *make_target(board);
  PlaneCamera camera = look_at(target, 15, -10, 12, 1.35);
  camera.size = {960, 720}, camera.centre = {479.5, 359.5}, camera.f = 900;
  Render how;
  how.blur_px = 3, how.noise = 3, how.samples = 3;
  const Detection d = found(render(camera, charuco_shade(board, false), how), target);
  const Accuracy a = accuracy(d, target, camera);
  EXPECT_EQ(a.found, 70) << d.reason;
  EXPECT_LT(a.worst, 0.3);  // four times the mean sigma of 0.06 px
}

// What is seen has its ids, under either layout, whichever side is cut off.
TEST(Charuco, HalfOutBoardHasItsIds) {
  for (const bool is_legacy : {false, true}) {
    for (const Vec2& shift : {Vec2(230, 0), Vec2(-240, 0), Vec2(0, 180), Vec2(0, -190)}) {
      const Target target = *make_target(small_board());
      PlaneCamera camera = look_at(target, 12, -8, 10, 1.5);
      camera.centre += shift;
      const Detection d = found(shown(camera, charuco_shade(small_board(), is_legacy)), target);
      const Accuracy a = accuracy(d, target, camera);
      EXPECT_LT(visible(target, camera), 32);
      EXPECT_GE(a.found, visible(target, camera)) << shift.transpose() << d.reason;
      EXPECT_LT(a.worst, kOwnPx) << shift.transpose();
      EXPECT_EQ(d.method.find("legacy") != std::string::npos, is_legacy);
      EXPECT_EQ(d.layout_vote < 0, is_legacy);
    }
  }
}

// Markers that cannot be read cost nothing as long as the corners can be seen.
TEST(Charuco, CoveredMarkersCostNoCorners) {
  const Target target = *make_target(small_board());
  const PlaneCamera camera = look_at(target, 10, 15, -8, 1.5);
  const Shade plain = charuco_shade(small_board(), false);
  const double s = small_board().square_m;
  // White sheets over all markers but those of the two right columns.
  const Shade covered = [=](const Vec2& p) {
    const double x = p.x() / s + 1, y = p.y() / s + 1, u = x - std::floor(x), v = y - std::floor(y);
    const bool is_white = (static_cast<int>(x) + static_cast<int>(y)) % 2 == 1;
    return x > 0 && y > 0 && x < 6 && y < 6 && is_white && u > 0.02 && v > 0.02 && u < 0.98 && v < 0.98
               ? 1.0
               : plain(p);
  };
  const Accuracy a = accuracy(found(shown(camera, covered), target), target, camera);
  EXPECT_EQ(a.found, 35);
  EXPECT_LT(a.worst, 0.1);
}

// Glare over a part of the board: what is left has its ids.
TEST(Charuco, GlareTakesOnlyWhatItCovers) {
  const Target target = *make_target(small_board());
  const PlaneCamera camera = look_at(target, -10, 15, 20, 1.5);
  cv::Mat image = shown(camera, charuco_shade(small_board(), false));
  const Vec2 at = camera.px_of(target.points[17]);
  cv::circle(image, {static_cast<int>(at.x()), static_cast<int>(at.y())}, 45, cv::Scalar(255), cv::FILLED);
  const Accuracy a = accuracy(found(image, target), target, camera);
  int clear = 0;  // by 5 px: a corner at the rim shows half of its edges
  for (const Vec3& p : target.points) clear += (camera.px_of(p) - at).norm() > 40 ? 1 : 0;
  EXPECT_LT(clear, 35);
  EXPECT_GE(a.found, 20);
  EXPECT_LE(a.found, clear);
  EXPECT_LT(a.worst, kOwnPx);
}

// Markers seen curved, up to 75 degrees off the axis.
TEST(Charuco, WideFisheye) {
  const Target target = *make_target(small_board());
  PlaneCamera camera = look_at(target, 25, -35, 12, 0.5);
  camera.is_fisheye = true;
  camera.size = {900, 760}, camera.centre = {449.5, 379.5}, camera.f = 290;
  const Detection d = found(shown(camera, charuco_shade(small_board(), false)), target);
  const Accuracy a = accuracy(d, target, camera);
  EXPECT_EQ(a.found, visible(target, camera)) << d.reason;
  EXPECT_LT(a.worst, 0.15);
}

// A mirror image, other dictionaries, the same markers on a board of other counts: none has a corner.
TEST(Charuco, OtherBoardsAreNone) {
  const Target target = *make_target(small_board());
  const PlaneCamera camera = look_at(target, 10, -15, 12, 1.6);
  cv::Mat mirrored = shown(camera, charuco_shade(small_board(), false));
  cv::flip(mirrored, mirrored, 1);
  EXPECT_TRUE(found(mirrored, target).corners.empty());
  for (const Charuco& other :
       {Charuco{8, 6, 0.03, 0.022, "5X5_100"}, Charuco{8, 6, 0.03, 0.022, "4X4_50", 24},
        Charuco{7, 6, 0.03, 0.022, "4X4_50"}, Charuco{8, 9, 0.03, 0.022, "4X4_50"}}) {
    const PlaneCamera at = look_at(*make_target(other), 10, -15, 12, 1.6);
    const Detection d = found(shown(at, charuco_shade(other, false)), target);
    EXPECT_TRUE(d.corners.empty()) << other.columns << "x" << other.rows << " " << other.dictionary << " "
                                   << other.first_id;
    EXPECT_THAT(d.reason, testing::ContainsRegex("[0-9]"));
  }
}

// Two boards side by side, one of which is asked for.
TEST(Charuco, AnotherBoardBesideItIsLeftAlone) {
  const Charuco board{5, 6, 0.03, 0.022, "4X4_50"}, other{5, 6, 0.03, 0.022, "4X4_50", 15};
  const Target target = *make_target(board);
  PlaneCamera camera = look_at(target, 8, -6, 4, 2.6);
  camera.centre.x() -= 120;
  const Shade first = charuco_shade(board, false), second = charuco_shade(other, false);
  const Shade both = [=](const Vec2& p) { return p.x() < 0.145 ? first(p) : second(p - Vec2(0.2, 0)); };
  const Detection d = found(shown(camera, both), target);
  const Accuracy a = accuracy(d, target, camera);
  EXPECT_EQ(a.found, 20) << d.reason;
  EXPECT_LT(a.worst, 0.2);
}

}  // namespace
}  // namespace plumbline::test
