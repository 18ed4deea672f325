// SPDX-License-Identifier: Apache-2.0
#include "plumbline/image/image.hpp"

#include <fstream>
#include <mutex>
#include <opencv2/imgcodecs.hpp>
#include <thread>

#include "support/support.hpp"

namespace plumbline::test {
namespace {

cv::Mat gradient(int type) {
  cv::Mat image(48, 64, type);
  for (int r = 0; r < image.rows; ++r)
    for (int c = 0; c < image.cols * image.channels(); ++c)
      image.ptr<unsigned char>(r)[c] = static_cast<unsigned char>(3 * r + c);
  return image;
}

bool same(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0;
}

TEST(Image, PngRoundTripIsExact) {
  const TempDir dir;
  for (const int type : {CV_8UC1, CV_8UC3}) {
    ASSERT_TRUE(write_png(dir / "a.png", gradient(type)));
    const auto back = read_image(dir / "a.png");
    ASSERT_TRUE(back) << back.error().text();
    EXPECT_TRUE(same(*back, gradient(type)));
    EXPECT_TRUE(same(cv::imread(dir / "a.png", cv::IMREAD_UNCHANGED), gradient(type)));
  }
  EXPECT_FALSE(std::filesystem::exists(dir / "a.png.part"));
}

TEST(Image, GreyOfColourIsOpenCvs) {
  const TempDir dir;
  ASSERT_TRUE(write_png(dir / "a.png", gradient(CV_8UC3)));
  EXPECT_TRUE(same(*read_image_grey(dir / "a.png"), cv::imread(dir / "a.png", cv::IMREAD_GRAYSCALE)));
}

// A photograph turned by its orientation tag has other pixels than the sensor; this JPEG says "turn by 90
// degrees".
TEST(Image, OrientationTagIsNotApplied) {
  const TempDir dir;
  cv::imwrite(dir / "plain.jpg", gradient(CV_8UC1));
  std::string bytes = read_text(dir / "plain.jpg");
  const std::string exif(
      "\xFF\xE1\x00\x22"
      "Exif\0\0MM\0\x2A\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0",
      36);
  bytes.insert(2, exif);
  write_text(dir / "turned.jpg", bytes);
  ASSERT_EQ(cv::imread(dir / "turned.jpg").rows, 64);  // OpenCV does turn it by default
  const auto image = read_image_grey(dir / "turned.jpg");
  ASSERT_TRUE(image) << image.error().text();
  EXPECT_EQ(image->rows, 48);
}

TEST(Image, MissingUnreadableAndUndecodableAreToldApart) {
  const TempDir dir;
  const auto missing = read_image_grey(dir / "no.png");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, ErrorCode::kIo);
  EXPECT_THAT(missing.error().text(), testing::HasSubstr("no such file"));
  EXPECT_THAT(missing.error().text(), testing::HasSubstr("no.png"));

  const auto folder = read_image_grey(dir.path());
  ASSERT_FALSE(folder);
  EXPECT_EQ(folder.error().code, ErrorCode::kIo);

  for (const std::string& text : {std::string(), std::string("this is no image"), std::string("P5 abc"),
                                  std::string("\xFF\xD8\xFF", 3)}) {
    write_text(dir / "bad.png", text);
    const auto bad = read_image_grey(dir / "bad.png");
    ASSERT_FALSE(bad) << text;
    EXPECT_EQ(bad.error().code, ErrorCode::kParse) << bad.error().text();
  }
}

// OpenCV fills the missing part of a cut JPEG with grey and says nothing that a program could read.
TEST(Image, CutFilesAreRefused) {
  const TempDir dir;
  for (const std::string name : {"a.jpg", "a.png"}) {
    cv::imwrite(dir / name, gradient(CV_8UC1));
    const std::string whole = read_text(dir / name);
    ASSERT_TRUE(read_image_grey(dir / name));
    for (const std::size_t left : {whole.size() - 3, whole.size() / 2, std::size_t{30}}) {
      write_text(dir / name, whole.substr(0, left));
      const auto cut = read_image_grey(dir / name);
      ASSERT_FALSE(cut) << name << " " << left;
      EXPECT_EQ(cut.error().code, ErrorCode::kParse);
      EXPECT_THAT(cut.error().message, testing::HasSubstr("before its end"));
    }
  }
}

// A header that promises 60000 x 60000 pixels must not allocate them.
TEST(Image, HugePromisesAreRefused) {
  const TempDir dir;
  ASSERT_TRUE(write_png(dir / "a.png", gradient(CV_8UC1)));
  std::string bytes = read_text(dir / "a.png");
  bytes.replace(16, 8, std::string("\0\0\xEA\x60\0\0\xEA\x60", 8));
  write_text(dir / "a.png", bytes);
  const auto huge = read_image_grey(dir / "a.png");
  ASSERT_FALSE(huge);
  EXPECT_THAT(huge.error().message, testing::HasSubstr("60000x60000"));
}

TEST(Image, WriteFailureLeavesNothing) {
  const TempDir dir;
  const auto failed = write_png(dir / "no_folder" / "a.png", gradient(CV_8UC1));
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().code, ErrorCode::kIo);
  if (std::filesystem::exists("/dev/full")) {
    // The part file cannot be made to sit on a full disc here, but a folder of its name stops it as well.
    std::filesystem::create_directory(dir / "b.png.part");
    EXPECT_FALSE(write_png(dir / "b.png", gradient(CV_8UC1)));
    EXPECT_FALSE(std::filesystem::exists(dir / "b.png"));
  }
}

TEST(Image, ThreadsReadAtOnce) {
  const TempDir dir;
  ASSERT_TRUE(write_png(dir / "a.png", gradient(CV_8UC1)));
  std::vector<std::thread> threads;
  std::atomic<int> good{0};
  for (int i = 0; i < 8; ++i) {
    threads.emplace_back([&] { good += read_image_grey(dir / "a.png").has_value() ? 1 : 0; });
  }
  for (auto& t : threads) t.join();
  EXPECT_EQ(good, 8);
}

/// Memory that this process has in use [MB].
double resident_mb() {
  std::ifstream statm("/proc/self/statm");
  double all = 0, resident = 0;
  statm >> all >> resident;
  return resident * 4096 / 1e6;
}

// 24 images of 6 MB on two threads: never more than one for each thread, with what its codec needs besides.
TEST(Image, ManyImagesAreNotHeld) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "sanitizers keep what is freed";
#endif
  const TempDir dir;
  ASSERT_TRUE(write_png(dir / "a.png", cv::Mat(2000, 3000, CV_8U, cv::Scalar(90))));
  const std::vector<std::filesystem::path> files(24, dir / "a.png");
  const double before = resident_mb();
  std::mutex lock;
  double most = 0;
  for_each_image(files, ReadAs::kGrey8, 2, [&](int, const Result<Photograph>& photograph) {
    ASSERT_TRUE(photograph);
    const std::lock_guard hold(lock);
    most = std::max(most, resident_mb() - before);
  });
  EXPECT_LT(most, 40);  // all of them would be 144 MB
}

}  // namespace
}  // namespace plumbline::test
