// SPDX-License-Identifier: Apache-2.0
#include "plumbline/image/video.hpp"

#include <atomic>
#include <mutex>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <set>

#include "plumbline/image/image.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

constexpr int kFrames = 40;

/// Frame k shows k in its brightness, and a fine pattern that is blurred but in the frames of `sharp`.
cv::Mat frame_of(int k, const std::set<int>& sharp) {
  cv::Mat grey(120, 160, CV_8U, cv::Scalar(30 + 5 * k));
  for (int r = 60; r < 120; ++r)
    for (int c = 0; c < 160; ++c) grey.at<unsigned char>(r, c) = (r / 4 + c / 4) % 2 ? 200 : 50;
  if (!sharp.contains(k)) cv::GaussianBlur(grey, grey, {}, 2.5);
  cv::Mat colour;
  cv::cvtColor(grey, colour, cv::COLOR_GRAY2BGR);
  return colour;
}

void write_video(const std::filesystem::path& file, const char* codec, const std::set<int>& sharp,
                 int n = kFrames) {
  cv::VideoWriter video(file.string(), cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]), 30,
                        {160, 120});
  ASSERT_TRUE(video.isOpened()) << codec;
  for (int k = 0; k < n; ++k) video.write(frame_of(k, sharp));
}

/// Which frame this is, by the brightness of its upper part; the codecs are lossy.
double number_of(const cv::Mat& frame) {
  cv::Mat grey = frame;
  if (frame.channels() == 3) cv::cvtColor(frame, grey, cv::COLOR_BGR2GRAY);
  return (cv::mean(grey(cv::Rect(0, 0, 160, 40)))[0] - 30) / 5;
}

TEST(Video, NamesOfFrames) {
  EXPECT_EQ(frame_path("a/b.mp4", 120), "a/b.mp4#000120");
  EXPECT_EQ(frame_path("b.avi", 1234567), "b.avi#1234567");
  const auto frame = parse_frame_path("a/b.MP4#000120");
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->video, "a/b.MP4");
  EXPECT_EQ(frame->frame, 120);
  for (const char* other : {"a.png#000120", "a.mp4", "a.mp4#", "a.mp4#-1", "a.mp4#+1", "a.mp4#12x", "#1", ""})
    EXPECT_FALSE(parse_frame_path(other)) << other;
  EXPECT_TRUE(is_video("x.MKV"));
  EXPECT_FALSE(is_video("x.png"));
}

// Every frame by its name is the frame that was written under this number, in containers with and without
// frames that depend on others.
TEST(Video, FramesAreExact) {
  const TempDir dir;
  for (const auto& [name, codec] :
       {std::pair{"a.avi", "MJPG"}, {"a.mp4", "mp4v"}, {"a.mkv", "mp4v"}, {"b.avi", "XVID"}}) {
    write_video(dir / name, codec, {});
    const auto scan = scan_video(dir / name);
    ASSERT_TRUE(scan) << scan.error().text();
    EXPECT_EQ(scan->sharpness.size(), static_cast<std::size_t>(kFrames)) << name;
    EXPECT_EQ(scan->size, (ImageSize{160, 120}));
    for (const int k : {0, 1, 17, kFrames - 1}) {
      const auto frame = read_image(frame_path(dir / name, k));
      ASSERT_TRUE(frame) << frame.error().text();
      EXPECT_EQ(frame->type(), CV_8UC3);
      EXPECT_NEAR(number_of(*frame), k, 0.4) << name;  // 0.5 is half way to the next frame
      const auto grey = read_image_grey(frame_path(dir / name, k));
      ASSERT_TRUE(grey);
      EXPECT_EQ(grey->type(), CV_8UC1);
    }
  }
}

TEST(Video, ManyFramesInOnePassAndAnyOrder) {
  const TempDir dir;
  write_video(dir / "a.avi", "MJPG", {});
  write_video(dir / "b.avi", "MJPG", {});
  ASSERT_TRUE(write_png(dir / "c.png", cv::Mat(4, 4, CV_8U, cv::Scalar(7))));
  std::vector<std::filesystem::path> files{frame_path(dir / "a.avi", 33), dir / "c.png",
                                           frame_path(dir / "b.avi", 2),  frame_path(dir / "a.avi", 5),
                                           frame_path(dir / "a.avi", 33), frame_path(dir / "b.avi", 99)};
  const std::vector<double> expected{33, -1, 2, 5, 33, -2};
  for (const int n_threads : {1, 4}) {
    std::vector<double> seen(files.size(), -9);
    for_each_image(files, ReadAs::kGrey8, n_threads, [&](int i, const Result<Photograph>& photograph) {
      if (!photograph)
        seen[i] = -2;
      else
        seen[i] = photograph->pixels.cols == 4 ? -1 : number_of(photograph->pixels);
    });
    for (std::size_t i = 0; i < files.size(); ++i) EXPECT_NEAR(seen[i], expected[i], 0.4) << i;
  }
}

TEST(Video, SharpestOfEachWindow) {
  const TempDir dir;
  const std::set<int> sharp{3, 14, 20, 38};
  write_video(dir / "a.avi", "MJPG", sharp);
  const auto scan = scan_video(dir / "a.avi");
  ASSERT_TRUE(scan);
  EXPECT_EQ(sharpest_frames({scan->sharpness}, 10)[0], (std::vector<int>{3, 14, 20, 38}));
  EXPECT_EQ(sharpest_frames({scan->sharpness}, 1)[0].size(), static_cast<std::size_t>(kFrames));
}

// Two cameras: the frame whose worse picture is best, by hand; when one video has ended, the other alone.
TEST(Video, OneFrameForAllCameras) {
  const std::vector<double> left{10, 8, 1, /**/ 2, 4, 4, /**/ 1, 3}, right{1, 6, 9, /**/ 5, 5};
  EXPECT_EQ(sharpest_frames({left, right}, 3), (std::vector<std::vector<int>>{{1, 4, 7}, {1, 4}}));
  EXPECT_EQ(sharpest_frames({left}, 3), (std::vector<std::vector<int>>{{0, 4, 7}}));
  EXPECT_EQ(sharpest_frames({{0, 0, 0}}, 2), (std::vector<std::vector<int>>{{0, 2}}));
  EXPECT_TRUE(sharpest_frames({}, 2).empty());
}

// The matrix of the track's header (ISO 14496-12, 8.3.2) says how to show it; the pixels stay as they are.
TEST(Video, RotationIsToldAndNotApplied) {
  const TempDir dir;
  write_video(dir / "a.mp4", "mp4v", {}, 3);
  std::string bytes = read_text(dir / "a.mp4");
  const std::string one("\0\1\0\0", 4), minus("\xFF\xFF\0\0", 4), zero(4, '\0'), w("\x40\0\0\0", 4);
  const std::size_t at =
      bytes.find(one + zero + zero + zero + one + zero + zero + zero + w, bytes.find("tkhd"));
  ASSERT_NE(at, std::string::npos);
  for (const auto& [matrix, orientation] : {std::pair{zero + one + zero + minus + zero, 6},
                                            {minus + zero + zero + zero + minus, 3},
                                            {zero + minus + zero + one + zero, 8}}) {
    bytes.replace(at, matrix.size(), matrix);
    write_text(dir / "turned.mp4", bytes);
    const auto frame = read_photograph(frame_path(dir / "turned.mp4", 2), ReadAs::kGrey8);
    ASSERT_TRUE(frame) << frame.error().text();
    EXPECT_EQ(frame->orientation, orientation);
    EXPECT_EQ(frame->pixels.size(), cv::Size(160, 120));
    EXPECT_NEAR(number_of(frame->pixels), 2, 0.4);
  }
}

TEST(Video, BadVideosAreRefused) {
  const TempDir dir;
  write_text(dir / "text.mp4", "this is no video at all, only text that says so at some length");
  write_text(dir / "empty.mp4", "");
  write_video(dir / "a.mp4", "mp4v", {}, 5);
  const std::string whole = read_text(dir / "a.mp4");
  write_text(dir / "cut.mp4", whole.substr(0, whole.size() / 2));  // its index is at the end
  for (const char* name : {"text.mp4", "empty.mp4", "cut.mp4"}) {
    const auto scan = scan_video(dir / name);
    ASSERT_FALSE(scan) << name;
    EXPECT_EQ(scan.error().code, ErrorCode::kParse) << scan.error().text();
    EXPECT_FALSE(read_image(frame_path(dir / name, 0)));
  }
  const auto missing = scan_video(dir / "missing.mp4");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, ErrorCode::kIo);
  const auto past = read_image(frame_path(dir / "a.mp4", 5));
  ASSERT_FALSE(past);
  EXPECT_THAT(past.error().text(), testing::HasSubstr("a.mp4#000005: the video ends before"));
  const auto whole_video = read_image(dir / "a.mp4");
  ASSERT_FALSE(whole_video);
  EXPECT_THAT(whole_video.error().text(), testing::HasSubstr("a.mp4#000000"));
}

}  // namespace
}  // namespace plumbline::test
