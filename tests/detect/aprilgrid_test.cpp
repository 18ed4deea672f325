// SPDX-License-Identifier: Apache-2.0
// AprilGrids as they are found in difficult pictures. A wrong id is worse than a missing one: every corner
// that is given has to lie where its point is.
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "detect/render.hpp"
#include "plumbline/detect/detect.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

Detection found(const cv::Mat& image, const AprilGrid& board) {
  const auto result = detect_target(image, *make_target(board));
  EXPECT_TRUE(result) << result.error().text();
  return result ? *result : Detection{};
}

/// Corners that lie `margin` px within the image.
std::set<int> visible(const PlaneCamera& camera, const Target& target, double margin) {
  std::set<int> out;
  for (int i = 0; i < static_cast<int>(target.points.size()); ++i) {
    const Vec2 p = camera.px_of(target.points[static_cast<std::size_t>(i)]);
    if (p.x() > margin && p.y() > margin && p.x() < camera.size.width - 1 - margin &&
        p.y() < camera.size.height - 1 - margin)
      out.insert(i);
  }
  return out;
}

std::set<int> points_of(const Detection& d) {
  std::set<int> out;
  for (const Corner& c : d.corners) out.insert(c.point);
  return out;
}

int n_missing(const std::set<int>& wanted, const Detection& d) {
  const std::set<int> got = points_of(d);
  return static_cast<int>(
      std::count_if(wanted.begin(), wanted.end(), [&](int i) { return !got.contains(i); }));
}

// Boards that were printed elsewhere: the target file says nothing of the border.
TEST(AprilGridFinder, FamiliesAndBorders) {
  for (const auto& [family, border] : {std::pair<std::string, int>{"36h11", 1}, {"25h9", 2}, {"25h9", 1}}) {
    const AprilGrid asked{5, 4, 0.088, 0.3, family, 3};
    AprilGrid shown = asked;
    shown.border = border;
    const Target target = *make_target(asked);
    const PlaneCamera camera = look_at(target, 20, -25, 30);
    const Detection d = found(render(camera, aprilgrid_shade(shown)), asked);
    const Accuracy a = accuracy(d, target, camera);
    EXPECT_EQ(a.found, 80) << family << " " << border << " " << d.reason;
    EXPECT_LT(a.worst, 0.15);
    EXPECT_LT(a.bias.cwiseAbs().maxCoeff(), 0.01);
  }
}

TEST(AprilGridFinder, HalfOutOfTheImage) {
  const AprilGrid board{6, 6, 0.088, 0.3};
  const Target target = *make_target(board);
  for (const Vec2& shift : {Vec2(0.3, 0.02), Vec2(-0.05, -0.28), Vec2(0.25, 0.2)}) {
    PlaneCamera camera = look_at(target, 20, -15, 25, 1.2);
    camera.t += Vec3(shift.x(), shift.y(), 0);
    const Detection d = found(render(camera, aprilgrid_shade(board)), board);
    const std::set<int> wanted = visible(camera, target, 2);
    EXPECT_LT(wanted.size(), 120U);
    EXPECT_EQ(n_missing(wanted, d), 0) << wanted.size() << " " << d.reason;
    EXPECT_LT(accuracy(d, target, camera).worst, 0.3);
  }
}

// One tag is in the image whole; those around it are read as far as they are in it.
TEST(AprilGridFinder, OneTagAndPiecesOfOthers) {
  const AprilGrid board{3, 3, 0.088, 0.3};
  const Target target = *make_target(board);
  PlaneCamera camera = look_at(target, 8, -6, 10, 0.62);
  const Detection d = found(render(camera, aprilgrid_shade(board)), board);
  const std::set<int> wanted = visible(camera, target, 8);  // nearer to the border half a window is outside
  ASSERT_LE(wanted.size(), 20U);
  EXPECT_EQ(n_missing(wanted, d), 0) << d.reason;
  EXPECT_LT(accuracy(d, target, camera).worst, 0.2);
}

// A lamp or a hand over the bits of tags: their corners are numbered by the lattice.
TEST(AprilGridFinder, TagsThatCannotBeRead) {
  const AprilGrid board{6, 4, 0.088, 0.3};
  const Target target = *make_target(board);
  const PlaneCamera camera = look_at(target, 15, 20, -12, 1.4);
  cv::Mat image = render(camera, aprilgrid_shade(board));
  for (int tag = 0; tag < 24; ++tag) {
    if (tag % 5 == 1) continue;  // five are left
    std::vector<cv::Point> inner;
    const Vec3 low = target.points[static_cast<std::size_t>(4 * tag)];
    for (const auto& [x, y] : {std::pair{0.2, 0.2}, {0.8, 0.2}, {0.8, 0.8}, {0.2, 0.8}}) {
      const Vec2 p = camera.px_of(low + 0.088 * Vec3(x, y, 0));
      inner.emplace_back(static_cast<int>(p.x()), static_cast<int>(p.y()));
    }
    cv::fillConvexPoly(image, inner, cv::Scalar(tag % 2 == 0 ? 255 : 30));
  }
  const Detection d = found(image, board);
  const Accuracy a = accuracy(d, target, camera);
  EXPECT_EQ(a.found, 96) << d.reason;
  EXPECT_LT(a.worst, 0.2);
}

// Light that saturates takes corners away, but moves none.
TEST(AprilGridFinder, GlareMovesNoCorner) {
  const AprilGrid board{6, 6, 0.088, 0.3};
  const Target target = *make_target(board);
  const PlaneCamera camera = look_at(target, 18, 12, 8, 1.4);
  cv::Mat image = render(camera, aprilgrid_shade(board));
  for (const auto& [x, y, r] : {std::tuple{250, 170, 45.0}, {400, 300, 60.0}}) {
    for (int v = 0; v < image.rows; ++v) {
      for (int u = 0; u < image.cols; ++u) {
        const double light = 600 * std::exp(-((u - x) * (u - x) + (v - y) * (v - y)) / (0.6 * r * r));
        auto& grey = image.at<unsigned char>(v, u);
        grey = cv::saturate_cast<unsigned char>(grey + light);
      }
    }
  }
  const Detection d = found(image, board);
  EXPECT_GT(d.corners.size(), 110U) << d.reason;
  EXPECT_LT(accuracy(d, target, camera).worst, 1.0);
}

TEST(AprilGridFinder, WideFisheye) {
  const AprilGrid board{6, 6, 0.088, 0.3};
  const Target target = *make_target(board);
  for (const double distance : {0.45, 0.6}) {
    PlaneCamera camera = look_at(target, 15, -20, 12, distance);
    camera.size = {800, 700};
    camera.centre = {399.5, 349.5};
    camera.is_fisheye = true;
    camera.f = 230;  // 180 degrees on the longer side
    const Detection d = found(render(camera, aprilgrid_shade(board)), board);
    const Accuracy a = accuracy(d, target, camera);
    EXPECT_EQ(n_missing(visible(camera, target, 3), d), 0) << d.reason;
    EXPECT_LT(a.rms_axis, 0.03);
    EXPECT_LT(a.worst, 0.3);
  }
}

TEST(AprilGridFinder, SmallBlurredAndNoisy) {
  const AprilGrid board{6, 6, 0.088, 0.3};
  const Target target = *make_target(board);
  Render far, blurred, noisy;
  blurred.blur_px = 2.5;
  noisy.noise = 20;
  for (const auto& [how, distance] : {std::pair{far, 3.0}, {blurred, 1.6}, {noisy, 1.6}}) {
    const PlaneCamera camera = look_at(target, 15, 10, 20, distance);
    const Detection d = found(render(camera, aprilgrid_shade(board), how), board);
    const Accuracy a = accuracy(d, target, camera);
    EXPECT_EQ(a.found, 144) << d.reason;
    EXPECT_LT(a.worst, 0.4);  // five times the sigma of the least sharp corner
  }
}

// Along its diagonal: the edges of each corner cross at 60 degrees.
TEST(AprilGridFinder, SeenAskew) {
  const AprilGrid board{6, 6, 0.088, 0.3};
  const Target target = *make_target(board);
  for (const double roll : {0.0, 35.0}) {
    const PlaneCamera camera = look_at(target, 42, 45, roll, 1.5);
    const Detection d = found(render(camera, aprilgrid_shade(board)), board);
    EXPECT_EQ(n_missing(visible(camera, target, 3), d), 0) << d.reason;
    EXPECT_LT(accuracy(d, target, camera).worst, 0.2);
  }
}

TEST(AprilGridFinder, AMirroredBoardIsNone) {
  const AprilGrid board{6, 6, 0.088, 0.3};
  cv::Mat image = render(look_at(*make_target(board), 10, 20, 5), aprilgrid_shade(board));
  cv::flip(image, image, 1);
  const Detection d = found(image, board);
  EXPECT_TRUE(d.corners.empty());
  EXPECT_EQ(d.reason, "0 of 36 tags found, at least 2 are needed");
}

// The same tags on a board with other columns: those of a row fit, the rows do not.
TEST(AprilGridFinder, TheSameTagsInOtherColumns) {
  for (const auto& [shown, asked] : {std::pair{7, 6}, {6, 7}, {5, 6}, {6, 5}}) {
    const AprilGrid there{shown, 4, 0.088, 0.3};
    const cv::Mat image = render(look_at(*make_target(there), 10, -15, 8), aprilgrid_shade(there));
    const Detection d = found(image, AprilGrid{asked, 6, 0.088, 0.3});
    EXPECT_TRUE(d.corners.empty()) << shown << " " << asked;
    EXPECT_THAT(d.reason, testing::HasSubstr("another one"));
  }
}

// Another part of the same family is not this board, and one beside it does not disturb.
TEST(AprilGridFinder, BoardsOfOtherIds) {
  const AprilGrid left{3, 3, 0.088, 0.3, "36h11", 0}, right{3, 3, 0.088, 0.3, "36h11", 9};
  const double step = 0.088 * 4.5;
  const Shade a = aprilgrid_shade(left), b = aprilgrid_shade(right);
  const Shade both = [&](const Vec2& p) { return p.x() < 0.088 * 4.2 ? a(p) : b(p - Vec2(step, 0)); };
  const Target target = *make_target(left);
  PlaneCamera camera = look_at(target, 10, 15, 5, 2.6);
  camera.t.x() -= 0.2;
  const cv::Mat image = render(camera, both);
  const Detection first = found(image, left), second = found(image, right);
  EXPECT_EQ(accuracy(first, target, camera).found, 36) << first.reason;
  EXPECT_LT(accuracy(first, target, camera).worst, 0.2);
  ASSERT_EQ(second.corners.size(), 36U) << second.reason;
  for (const Corner& c : second.corners) {
    const Vec3 p = target.points[static_cast<std::size_t>(c.point)] + Vec3(step, 0, 0);
    EXPECT_LT((c.px - camera.px_of(p)).norm(), 0.2);
  }
  EXPECT_TRUE(found(image, AprilGrid{3, 3, 0.088, 0.3, "36h11", 50}).corners.empty());
  EXPECT_TRUE(found(image, AprilGrid{3, 3, 0.088, 0.3, "25h9", 0}).corners.empty());
}

}  // namespace
}  // namespace plumbline::test
