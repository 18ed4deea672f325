// SPDX-License-Identifier: Apache-2.0
// Images as people have them. OpenCV's own encoders write the files, so what is expected is known before.
#include <array>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "plumbline/image/image.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

/// A picture with all levels from `low` to `high`, and no symmetry.
cv::Mat levels(int low, int high, int type = CV_16UC1) {
  cv::Mat image(96, 128, type);
  const int channels = image.channels();
  for (int r = 0; r < image.rows; ++r) {
    for (int c = 0; c < image.cols * channels; ++c) {
      const int at = (r * image.cols * channels + c) * 7919 % (image.rows * image.cols);
      const int level = low + at * (high - low) / (image.rows * image.cols - 1);
      if (image.depth() == CV_8U)
        image.ptr<unsigned char>(r)[c] = static_cast<unsigned char>(level);
      else
        image.ptr<unsigned short>(r)[c] = static_cast<unsigned short>(level);
    }
  }
  return image;
}

double largest_difference(const cv::Mat& a, const cv::Mat& b) {
  if (a.size() != b.size() || a.type() != b.type()) return 1e9;
  return cv::norm(a, b, cv::NORM_INF);
}

/// An EXIF segment's TIFF part with nothing but an orientation.
std::string exif(int orientation, bool little) {
  std::string tiff = little
                         ? std::string("II\x2A\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0?\0\0\0\0\0\0\0", 26)
                         : std::string("MM\0\x2A\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0?\0\0\0\0\0\0", 26);
  tiff[tiff.find('?')] = static_cast<char>(orientation);
  return tiff;
}

/// PNG's checksum (ISO 15948, annex D).
std::string crc_of(const std::string& bytes) {
  std::uint32_t crc = 0xFFFFFFFF;
  for (const char byte : bytes) {
    crc ^= static_cast<unsigned char>(byte);
    for (int i = 0; i < 8; ++i) crc = crc & 1 ? 0xEDB88320 ^ crc >> 1 : crc >> 1;
  }
  crc = ~crc;
  std::string out;
  for (const int shift : {24, 16, 8, 0}) out += static_cast<char>(crc >> shift & 255);
  return out;
}

TEST(Formats, EightBitGreyIsTheSameInEveryLosslessFormat) {
  const TempDir dir;
  const cv::Mat image = levels(0, 255, CV_8UC1);
  for (const char* name : {"a.png", "a.tif", "a.bmp", "a.pgm"}) {
    ASSERT_TRUE(cv::imwrite(dir / name, image));
    const auto grey = read_image_grey(dir / name);
    ASSERT_TRUE(grey) << grey.error().text();
    EXPECT_EQ(largest_difference(*grey, image), 0) << name;
    EXPECT_EQ(largest_difference(*read_image(dir / name), image), 0) << name;
  }
}

// The weights of ITU-R BT.601, which OpenCV documents for its grey; codecs round in their own ways.
TEST(Formats, ColourAndAlpha) {
  const TempDir dir;
  const cv::Mat colour = levels(0, 255, CV_8UC3);
  cv::Mat with_alpha, expected(colour.size(), CV_8UC1);
  cv::cvtColor(colour, with_alpha, cv::COLOR_BGR2BGRA);
  for (int r = 0; r < colour.rows; ++r) {
    for (int c = 0; c < colour.cols; ++c) {
      const auto& p = colour.at<cv::Vec3b>(r, c);
      expected.at<unsigned char>(r, c) =
          cv::saturate_cast<unsigned char>(0.114 * p[0] + 0.587 * p[1] + 0.299 * p[2]);
      with_alpha.at<cv::Vec4b>(r, c)[3] = static_cast<unsigned char>(r);  // nearly transparent at the top
    }
  }
  for (const char* name : {"a.png", "a.tif", "a.bmp", "a.ppm", "alpha.png", "alpha.tif", "alpha.bmp"}) {
    const bool has_alpha = std::string(name).starts_with("alpha");
    ASSERT_TRUE(cv::imwrite(dir / name, has_alpha ? with_alpha : colour));
    const auto grey = read_image_grey(dir / name);
    ASSERT_TRUE(grey) << grey.error().text();
    EXPECT_LE(largest_difference(*grey, expected), 1) << name;
    const auto stored = read_image(dir / name);
    ASSERT_TRUE(stored);
    EXPECT_EQ(largest_difference(*stored, colour), 0) << name;
  }
}

// 16 bits use all 256 levels from the image's own darkest to its brightest, and 12 bits in 16 the same ones.
TEST(Formats, SixteenBitsAreSpreadOverTheirOwnRange) {
  const TempDir dir;
  for (const auto& [low, high] : {std::pair{0, 65535}, {0, 4095}, {256, 4095}, {7000, 8500}, {900, 1400}}) {
    const cv::Mat image = levels(low, high);
    cv::Mat expected;
    image.convertTo(expected, CV_8U, 255.0 / (high - low), -255.0 * low / (high - low));
    for (const char* name : {"a.png", "a.tif", "a.pgm"}) {
      ASSERT_TRUE(cv::imwrite(dir / name, image));
      const auto grey = read_image_grey(dir / name);
      ASSERT_TRUE(grey) << grey.error().text();
      // One of 12288 pixels at each end does not count, which moves the ends by 1/12288 of the range.
      EXPECT_LE(largest_difference(*grey, expected), 1) << name << " " << low << " " << high;
      EXPECT_EQ(largest_difference(*read_image(dir / name), image), 0) << name;  // as it is stored
    }
  }
  ASSERT_TRUE(cv::imwrite(dir / "colour.png", levels(0, 3000, CV_16UC3)));
  const auto grey = read_image_grey(dir / "colour.png");
  ASSERT_TRUE(grey) << grey.error().text();
  EXPECT_EQ(grey->type(), CV_8UC1);
  double low = 0, high = 0;
  cv::minMaxLoc(*grey, &low, &high);
  EXPECT_EQ(low, 0);
  EXPECT_EQ(high, 255);
}

// Eight bits in a file of sixteen stay as they are, and levels are not invented.
TEST(Formats, SixteenBitFilesOfEightBits) {
  const cv::Mat few = levels(30, 210);
  cv::Mat same;
  few.convertTo(same, CV_8U);
  EXPECT_EQ(largest_difference(to_8bit(few), same), 0);
  const cv::Mat dark = levels(1000, 1040);
  double low = 0, high = 0;
  cv::minMaxLoc(to_8bit(dark), &low, &high);
  EXPECT_EQ(high - low, 40);
}

TEST(Formats, HotAndDeadPixelsDoNotCount) {
  cv::Mat image = levels(500, 3000);
  const cv::Mat before = to_8bit(image);
  image.at<unsigned short>(5, 7) = 65535;
  const cv::Mat after = to_8bit(image);
  EXPECT_EQ(after.at<unsigned char>(5, 7), 255);
  cv::Mat difference;
  cv::absdiff(before, after, difference);
  difference.at<unsigned char>(5, 7) = 0;
  EXPECT_LE(cv::norm(difference, cv::NORM_INF), 1);
}

TEST(Formats, FloatsAreSpreadToo) {
  const TempDir dir;
  cv::Mat image;
  levels(0, 10000).convertTo(image, CV_32F, 1e-4, -0.5);
  image.at<float>(3, 4) = std::numeric_limits<float>::quiet_NaN();
  ASSERT_TRUE(cv::imwrite(dir / "a.tif", image));
  for (const auto& read : {read_image_grey(dir / "a.tif"), read_image(dir / "a.tif")}) {
    ASSERT_TRUE(read) << read.error().text();
    ASSERT_EQ(read->type(), CV_8UC1);
    cv::Mat expected;
    levels(0, 10000).convertTo(expected, CV_8U, 255e-4);
    expected.at<unsigned char>(3, 4) = read->at<unsigned char>(3, 4);
    EXPECT_LE(largest_difference(*read, expected), 1);
  }
}

// Hand-made tags in both byte orders and in each container that can carry one; the pixels stay.
TEST(Formats, OrientationIsToldAndNotApplied) {
  const TempDir dir;
  const cv::Mat image = levels(0, 255, CV_8UC1);
  for (const int orientation : {1, 3, 6, 8}) {
    for (const bool little : {true, false}) {
      const std::string tiff = exif(orientation, little);
      cv::imwrite(dir / "plain.jpg", image);
      std::string jpeg = read_text(dir / "plain.jpg");
      const std::size_t length = 2 + 6 + tiff.size();
      jpeg.insert(2, std::string("\xFF\xE1") + static_cast<char>(length / 256) +
                         static_cast<char>(length % 256) + std::string("Exif\0\0", 6) + tiff);
      write_text(dir / "a.jpg", jpeg);
      const auto photograph = read_photograph(dir / "a.jpg", ReadAs::kGrey8);
      ASSERT_TRUE(photograph) << photograph.error().text();
      EXPECT_EQ(photograph->orientation, orientation);
      EXPECT_EQ(photograph->pixels.size(), image.size());

      cv::imwrite(dir / "plain.png", image);
      std::string png = read_text(dir / "plain.png");
      std::string chunk = std::string("\0\0\0", 3) + static_cast<char>(tiff.size()) + "eXIf" + tiff;
      png.insert(33, chunk + crc_of(chunk.substr(4)));  // behind IHDR
      write_text(dir / "a.png", png);
      const auto of_png = read_photograph(dir / "a.png", ReadAs::kGrey8);
      ASSERT_TRUE(of_png) << of_png.error().text();
      EXPECT_EQ(of_png->orientation, orientation);
      EXPECT_EQ(largest_difference(of_png->pixels, image), 0);
    }
  }
  const auto none = read_photograph(dir / "plain.jpg", ReadAs::kGrey8);
  ASSERT_TRUE(none);
  EXPECT_EQ(none->orientation, 1);
}

// A TIFF by hand (TIFF 6.0, section 4: greyscale, uncompressed), since OpenCV's encoder writes no
// orientation.
TEST(Formats, OrientationOfTiff) {
  const TempDir dir;
  const cv::Mat image = levels(0, 255, CV_8UC1);
  std::string bytes("II\x2A\0\x08\0\0\0", 8);
  const auto number = [&](unsigned value, int n) {
    for (int i = 0; i < n; ++i) bytes += static_cast<char>(value >> 8 * i & 255);
  };
  const unsigned n_pixels = static_cast<unsigned>(image.total());
  const std::vector<std::array<unsigned, 2>> entries{
      {256, 128}, {257, 96}, {258, 8},  {259, 1},       {262, 1}, {273, 8 + 2 + 10 * 12 + 4},
      {274, 6},   {277, 1},  {278, 96}, {279, n_pixels}};
  number(static_cast<unsigned>(entries.size()), 2);
  for (const auto& [tag, value] : entries) {
    number(tag, 2);
    number(3, 2);  // short
    number(1, 4);
    number(value, 4);
  }
  number(0, 4);
  bytes.append(reinterpret_cast<const char*>(image.data), n_pixels);
  write_text(dir / "a.tif", bytes);
  const auto photograph = read_photograph(dir / "a.tif", ReadAs::kGrey8);
  ASSERT_TRUE(photograph) << photograph.error().text();
  EXPECT_EQ(photograph->orientation, 6);
  EXPECT_EQ(largest_difference(photograph->pixels, image), 0);
}

// Tags that lie, end early or point outside of the file are no tags, and read nothing that is not there.
TEST(Formats, HostileTags) {
  const TempDir dir;
  cv::imwrite(dir / "plain.jpg", levels(0, 255, CV_8UC1));
  const std::string plain = read_text(dir / "plain.jpg"), whole = exif(6, true);
  std::vector<std::string> tags{exif(9, true), exif(0, false)};
  for (std::size_t n = 0; n < whole.size() - 8; ++n) tags.push_back(whole.substr(0, n));
  std::string far = whole;
  far[4] = far[5] = far[6] = far[7] = '\xFF';
  tags.push_back(far);
  for (const std::string& tag : tags) {
    const std::size_t length = 2 + 6 + tag.size();
    std::string jpeg = plain;
    jpeg.insert(2, std::string("\xFF\xE1") + static_cast<char>(length / 256) +
                       static_cast<char>(length % 256) + std::string("Exif\0\0", 6) + tag);
    write_text(dir / "a.jpg", jpeg);
    const auto photograph = read_photograph(dir / "a.jpg", ReadAs::kGrey8);
    ASSERT_TRUE(photograph) << photograph.error().text();
    EXPECT_EQ(photograph->orientation, 1) << tag.size();
  }
}

// What OpenCV makes of a cut file of each format: nothing may pass with pixels that were never there.
TEST(Formats, CutFilesAreRefused) {
  const TempDir dir;
  for (const char* name : {"a.pgm", "a.ppm", "a.bmp", "a.tif", "a.webp"}) {
    const bool colour = std::string(name) == "a.ppm";
    ASSERT_TRUE(cv::imwrite(dir / name, levels(0, 255, colour ? CV_8UC3 : CV_8UC1)));
    const std::string whole = read_text(dir / name);
    for (const std::size_t left : {whole.size() - 1, whole.size() / 2}) {
      write_text(dir / name, whole.substr(0, left));
      const auto cut = read_image_grey(dir / name);
      EXPECT_FALSE(cut) << name << " " << left << " of " << whole.size();
      if (!cut) {
        EXPECT_EQ(cut.error().code, ErrorCode::kParse);
      }
    }
  }
}

// Each format's first bytes and nothing behind them.
TEST(Formats, BeginningsOfFilesAreRefused) {
  const TempDir dir;
  using namespace std::string_literals;
  for (const std::string& head :
       {"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"s,
        "\xFF\xD8\xFF\xE1\0\x10"
        "Exif\0\0"s,
        "II*\0\x08\0\0\0\x01\0"s, "MM\0*\0\0\0\x08"s, "RIFF\x10\0\0\0WEBPVP8X"s, "P5\n12 12\n255\n"s,
        "\0\0\0\x18"
        "ftypheic"s,
        "BM\x46\0\0\0\0\0\0\0"s}) {
    for (std::size_t n = 1; n <= head.size(); ++n) {
      write_text(dir / "cut.bin", head.substr(0, n));
      EXPECT_FALSE(read_image_grey(dir / "cut.bin")) << n << " bytes of " << head;
    }
  }
}

TEST(Formats, PhonesPhotographsAreNamed) {
  const TempDir dir;
  write_text(dir / "a.heic", std::string("\0\0\0\x18", 4) + "ftypheic" + std::string(40, 'x'));
  const auto heic = read_image_grey(dir / "a.heic");
  ASSERT_FALSE(heic);
  EXPECT_THAT(heic.error().message, testing::HasSubstr("HEIC"));
}

}  // namespace
}  // namespace plumbline::test
