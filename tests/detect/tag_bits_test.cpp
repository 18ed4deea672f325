// SPDX-License-Identifier: Apache-2.0
#include "detect/tag_bits.hpp"

#include <apriltag/apriltag.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h11.h>

#include <bit>
#include <cstdlib>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "detect/planar.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

using namespace detail;

/// The AprilTag library's own drawing of a tag with a border of `border` modules, `scale` px a module, from
/// 40 to 200 grey levels.
cv::Mat drawn(const std::string& name, int id, int border, int scale) {
  apriltag_family_t* family = name == "25h9" ? tag25h9_create() : tag36h11_create();
  image_u8_t* theirs = apriltag_to_image(family, static_cast<std::uint32_t>(id));
  // Theirs has a white rim and a border of one module.
  const int inner = theirs->width - 4, n = inner + 2 * border;
  cv::Mat modules(n, n, CV_8U, cv::Scalar(40)), image;
  for (int r = 0; r < inner; ++r) {
    for (int c = 0; c < inner; ++c) {
      if (theirs->buf[(r + 2) * theirs->stride + c + 2] != 0)
        modules.at<unsigned char>(r + border, c + border) = 200;
    }
  }
  cv::resize(modules, image, cv::Size(), scale, scale, cv::INTER_NEAREST);
  std::free(theirs->buf);  // image_u8_destroy is not exported by every build of the library
  std::free(theirs);
  name == "25h9" ? tag25h9_destroy(family) : tag36h11_destroy(family);
  return image;
}

/// The tag fills the image but for `off` pixels.
std::optional<TagBits> bits_of(const cv::Mat& image, int n, int border, const Vec2& off = Vec2::Zero()) {
  const double side = image.cols;
  const Vec2 a = off - Vec2(0.5, 0.5);
  const auto H = square_to_quad({a, a + Vec2(side, 0), a + Vec2(side, side), a + Vec2(0, side)});
  return threshold_cells(read_cells(image, *H, n + 2 * border), border);
}

TEST(TagBits, ReadsWhatAprilTagDraws) {
  for (const std::string family : {"36h11", "25h9"}) {
    const TagBook& book = *april_book(family);
    ASSERT_EQ(book.codes.size(), family == "25h9" ? 35U : 587U);
    for (const int border : {1, 2}) {
      for (const int id : {0, 7, 34}) {
        cv::Mat image = drawn(family, id, border, 5);
        for (int turn = 0; turn < 4; ++turn) {
          const auto bits = bits_of(image, book.n, border);
          ASSERT_TRUE(bits);
          EXPECT_GE(bits->contrast, 160);
          EXPECT_LE(bits->contrast, 1.8 * 160);  // all of a white module whose neighbours are dark
          const TagReading found = match_code(*bits, book);
          EXPECT_EQ(found.id, id);
          EXPECT_EQ(found.errors, 0);
          EXPECT_GE(found.next, book.distance);
          // The upright tag's top left was read at corner `turn`, clockwise from the image's top left.
          EXPECT_EQ(found.turn, turn) << family << " " << border << " " << id;
          EXPECT_EQ(count_errors(*bits, book, id, turn), 0);
          cv::rotate(image, image, cv::ROTATE_90_CLOCKWISE);
        }
        cv::flip(image, image, 1);
        const auto mirrored = bits_of(image, book.n, border);
        ASSERT_TRUE(mirrored);
        EXPECT_GT(match_code(*mirrored, book).errors, most_errors(book)) << family << " " << id;
      }
    }
  }
}

// The families' distance is what the reading of damaged tags relies on.
TEST(TagBits, CodesDifferByTheFamilysDistance) {
  for (const std::string family : {"36h11", "25h9"}) {
    const TagBook& book = *april_book(family);
    int least = 64;
    for (std::size_t i = 0; i < book.codes.size(); i += family == "25h9" ? 1 : 13) {
      const std::uint64_t all = (std::uint64_t{1} << (book.n * book.n)) - 1;
      const TagReading found = match_code({book.n, book.codes[i], all, 100}, book);
      EXPECT_EQ(found.id, static_cast<int>(i));
      least = std::min(least, found.next);
    }
    EXPECT_GE(least, book.distance);
    EXPECT_LE(least, book.distance + 1);
  }
}

TEST(TagBits, LightThatChangesOverTheTag) {
  const TagBook& book = *april_book("36h11");
  cv::Mat image = drawn("36h11", 101, 2, 6);
  // To a third of it from one side to the other: white on the dark side is below black on the bright one.
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      auto& v = image.at<unsigned char>(y, x);
      v = static_cast<unsigned char>(v * (1 - 0.8 * x / image.cols) + 50.0 * y / image.rows);
    }
  }
  const auto bits = bits_of(image, book.n, 2);
  ASSERT_TRUE(bits);
  const TagReading found = match_code(*bits, book);
  EXPECT_EQ(found.id, 101);
  EXPECT_LE(found.errors, 2);
}

TEST(TagBits, PartsOutsideOfTheImageAreUnknown) {
  const TagBook& book = *april_book("36h11");
  const cv::Mat image = drawn("36h11", 55, 2, 5);
  // Half of the tag is above the image: rows 0 to 2 of its bits.
  const auto bits = bits_of(image.rowRange(25, 50), book.n, 2, Vec2(0, -25));
  ASSERT_TRUE(bits);
  EXPECT_EQ(std::popcount(bits->is_inside), 18);
  EXPECT_EQ(bits->is_inside >> 18, (std::uint64_t{1} << 18) - 1);
  EXPECT_EQ(count_errors(*bits, book, 55, 0), 0);
  EXPECT_GT(count_errors(*bits, book, 56, 0), 2);
}

TEST(TagBits, NoTagNoBits) {
  const cv::Mat flat(50, 50, CV_8U, cv::Scalar(90)), white(50, 50, CV_8U, cv::Scalar(250));
  EXPECT_FALSE(bits_of(flat, 6, 2));
  EXPECT_FALSE(bits_of(white, 6, 2));
  // A border that is not dark all around.
  cv::Mat open = drawn("36h11", 3, 2, 5);
  open.colRange(0, 10).setTo(200);
  EXPECT_FALSE(bits_of(open, 6, 2));
  EXPECT_EQ(april_book("16h5"), nullptr);
}

TEST(SquareToQuad, IsOpenCVsPerspectiveTransform) {
  const std::array<Vec2, 4> px{Vec2(10, 12), Vec2(95, 20), Vec2(80, 90), Vec2(20, 70)};
  const auto H = square_to_quad(px);
  ASSERT_TRUE(H);
  std::vector<cv::Point2f> from{{0, 0}, {1, 0}, {1, 1}, {0, 1}}, to;
  for (const Vec2& p : px) to.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
  const cv::Mat theirs = cv::getPerspectiveTransform(from, to);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) EXPECT_NEAR((*H)(r, c), theirs.at<double>(r, c), 1e-9 * 100);
  }
  EXPECT_FALSE(square_to_quad({Vec2(0, 0), Vec2(10, 0), Vec2(2, 1), Vec2(0, 10)}));  // not convex
}

}  // namespace
}  // namespace plumbline::test
