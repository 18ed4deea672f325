// SPDX-License-Identifier: Apache-2.0
// Videos and photographs with orientation tags or 16 bits, as a whole run takes them.
#include <fmt/format.h>

#include <array>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "detect/orientation.hpp"
#include "detect/render.hpp"
#include "plumbline/detect/detect.hpp"
#include "plumbline/image/image.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

const Chessboard kBoard{7, 5, 0.025};

cv::Mat shot(double pitch, double roll) {
  Render how;
  how.samples = 2;
  return render(look_at(*make_target(kBoard), pitch, 8, roll), chessboard_shade(kBoard), how);
}

/// A video of windows of five frames: in each one pose, sharp in the frame `sharp` of the window only.
void write_video(const std::filesystem::path& file, const std::vector<cv::Mat>& poses,
                 const std::vector<int>& sharp) {
  cv::VideoWriter video(file.string(), cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 30, {640, 480});
  ASSERT_TRUE(video.isOpened());
  for (std::size_t w = 0; w < poses.size(); ++w) {
    for (int k = 0; k < 5; ++k) {
      cv::Mat frame = poses[w].clone();
      if (k != sharp[w]) cv::GaussianBlur(poses[w], frame, {}, 2);
      cv::cvtColor(frame, frame, cv::COLOR_GRAY2BGR);
      video.write(frame);
    }
  }
}

CameraImages video_of(const std::string& camera, const std::filesystem::path& file) {
  return {camera, {file}, {file.filename().string()}, {file.stem().string()}};
}

TEST(DetectVideos, SharpestFramesPairsAndNearDuplicates) {
  const TempDir dir;
  const std::vector<cv::Mat> poses{shot(10, 5), shot(-15, 20),
                                   shot(10, 5.3)};  // the third: the first, nearly
  write_video(dir / "left.avi", poses, {3, 1, 2});
  write_video(dir / "right.avi", {poses[1], poses[0], poses[1]}, {3, 1, 2});
  const auto images =
      sample_videos({video_of("left", dir / "left.avi"), video_of("right", dir / "right.avi")}, {.every = 5});
  ASSERT_TRUE(images) << images.error().text();
  for (const CameraImages& camera : *images) {
    EXPECT_THAT(camera.frames, testing::ElementsAre("000003", "000006", "000012"));
    EXPECT_THAT(camera.names, testing::Contains(camera.camera + ".avi#000006"));
  }
  DetectOptions options;
  std::vector<std::string> notes;
  options.note = [&](const std::string& note) { notes.push_back(note); };
  const auto data = detect_dataset(*images, *make_target(kBoard), options);
  ASSERT_TRUE(data) << data.error().text();
  EXPECT_THAT(notes, testing::ElementsAre("left: left.avi: 15 frames, the sharpest of every 5 taken: 3",
                                          "right: right.avi: 15 frames, the sharpest of every 5 taken: 3"));
  EXPECT_THAT(data->frames, testing::ElementsAre("000003", "000006", "000012"));
  ASSERT_EQ(data->views.size(), 6U);
  for (const View& view : data->views) {
    EXPECT_EQ(view.image, data->cameras[view.cam].name + ".avi#" + data->frames[view.frame]);
    EXPECT_EQ(is_near_duplicate(view), view.frame == 2) << view.reason;
  }
  // 0.3 degrees at the outermost corner, 3.6 squares of 51 px from the middle: 0.96 px (the limit is 1.6).
  EXPECT_THAT(
      data->views[2].reason,
      testing::MatchesRegex("near-duplicate of frame 000003: corners moved by (0.9|1.0|1.1) px at most"));
  EXPECT_TRUE(validate(*data));

  options.thin_px = 0;
  options.n_threads = 1;
  const auto all = detect_dataset(*images, *make_target(kBoard), options);
  ASSERT_TRUE(all);
  for (std::size_t v = 0; v < 6; ++v) {
    EXPECT_EQ(all->views[v].corners.size(), 35U);
    if (all->views[v].frame == 2) continue;
    ASSERT_EQ(data->views[v].corners.size(), 35U);
    for (std::size_t k = 0; k < 35; ++k) EXPECT_EQ(data->views[v].corners[k].px, all->views[v].corners[k].px);
  }
}

// A file that ends early is used as far as it goes, and its user is told.
TEST(DetectVideos, CutVideosAreNamed) {
  const TempDir dir;
  write_video(dir / "a.avi", std::vector<cv::Mat>(4, cv::Mat(480, 640, CV_8U, cv::Scalar(90))), {0, 0, 0, 0});
  const std::string whole = read_text(dir / "a.avi");
  write_text(dir / "a.avi", whole.substr(0, whole.size() / 2));
  const auto images = sample_videos({video_of("a", dir / "a.avi")}, {.every = 5});
  ASSERT_TRUE(images) << images.error().text();
  EXPECT_LT(images->front().files.size(), 4U);
  EXPECT_THAT(images->front().notes,
              testing::Contains(testing::HasSubstr("a.avi promises 20 frames, of which")));
}

/// A data set of two cameras and four frames of the same three corners, each frame moved by so much.
Dataset moved(const std::array<double, 4>& left_px, const std::array<double, 4>& right_px, bool video) {
  Dataset data;
  data.targets = {*make_target(kBoard)};
  data.cameras = {{"left", {600, 800}}, {"right", {600, 800}}};
  for (int cam = 0; cam < 2; ++cam) {
    for (int f = 0; f < 4; ++f) {
      if (cam == 0) data.frames.push_back(fmt::format("{:06d}", f));
      const double x = cam == 0 ? left_px[f] : right_px[f];
      View view{cam, f, fmt::format("{}{}", video ? "a.avi#" : "a", f), {}, "", 0};
      for (int k = 0; k < 3; ++k) view.corners.push_back({k, Vec2(100 + 50 * k + x, 100 + 30 * k), 0.1});
      data.views.push_back(view);
    }
  }
  return data;
}

std::vector<bool> left_out(Dataset data, std::optional<double> thin_px) {
  thin_near_duplicates(data, thin_px);
  std::vector<bool> out(data.frames.size(), true);
  for (const View& view : data.views) {
    if (!is_near_duplicate(view)) out[view.frame] = false;
    EXPECT_EQ(view.corners.empty(), !view.reason.empty());
  }
  for (const View& view : data.views) EXPECT_EQ(is_near_duplicate(view), out[view.frame]);  // all or none
  return out;
}

TEST(DetectVideos, ThinningNeedsAllCamerasAndAllCorners) {
  using Out = std::vector<bool>;
  const std::array<double, 4> still{0, 0, 0, 0}, slow{0, 1.5, 3, 4.5}, jump{0, 0, 50, 0};
  // The diagonal is 1000 px, so that 2 px is the limit for videos.
  EXPECT_EQ(left_out(moved(still, still, true), std::nullopt), (Out{false, true, true, true}));
  EXPECT_EQ(left_out(moved(still, still, false), std::nullopt), (Out{false, false, false, false}));
  EXPECT_EQ(left_out(moved(still, still, true), 0.0), (Out{false, false, false, false}));
  EXPECT_EQ(left_out(moved(still, still, false), 0.1), (Out{false, true, true, true}));
  // Against what is kept: 1.5 px is near the first; 3 px is not, and stays; 4.5 px is near that one.
  EXPECT_EQ(left_out(moved(still, slow, true), std::nullopt), (Out{false, true, false, true}));
  // One camera that moved keeps the frame; coming back, the first one is met again.
  EXPECT_EQ(left_out(moved(jump, still, true), std::nullopt), (Out{false, true, false, true}));
  Dataset more = moved(still, still, true);
  more.views[1].corners.push_back({9, Vec2(300, 300), 0.1});  // a corner that frame 0 has not
  EXPECT_EQ(left_out(more, std::nullopt), (Out{false, false, true, true}));
  Dataset fewer = moved(still, still, true);
  fewer.views[1].corners.pop_back();
  fewer.views[5].corners.clear();
  fewer.views[5].reason = "none";
  thin_near_duplicates(fewer);
  EXPECT_TRUE(is_near_duplicate(fewer.views[1]));
  EXPECT_EQ(fewer.views[5].reason, "none");
}

TEST(DetectVideos, KeysOfSeveralVideos) {
  const TempDir dir;
  const std::vector<cv::Mat> flat(1, cv::Mat(480, 640, CV_8U, cv::Scalar(90)));
  for (const char* name : {"l1.avi", "l2.avi", "r1.avi"}) write_video(dir / name, flat, {0});
  const CameraImages left{"l", {dir / "l1.avi", dir / "l2.avi"}, {"l1.avi", "l2.avi"}, {"1", "2"}};
  const CameraImages right{"r", {dir / "r1.avi"}, {"r1.avi"}, {"1"}};
  const auto images = sample_videos({left, right}, {.every = 3});
  ASSERT_TRUE(images) << images.error().text();
  EXPECT_THAT((*images)[0].frames, testing::ElementsAre("1/000000", "1/000003", "2/000000", "2/000003"));
  EXPECT_THAT((*images)[1].frames, testing::ElementsAre("1/000000", "1/000003"));
  write_text(dir / "r1.avi", "no video");
  const auto bad = sample_videos({left, right}, {.every = 3});
  ASSERT_FALSE(bad);
  EXPECT_EQ(bad.error().where, "r1.avi");
}

// An image of 16 bits whose brightest pixel is at 2 % of the range is the 8-bit image, whatever the others
// are.
TEST(DetectDataset, SixteenBitsAndDark) {
  const TempDir dir;
  const cv::Mat bright = shot(12, -10);
  cv::Mat dark;
  bright.convertTo(dark, CV_16U, 5, 60);
  cv::imwrite(dir / "a1.png", dark);
  cv::imwrite(dir / "a2.png", bright);
  const CameraImages both{"a", {dir / "a1.png", dir / "a2.png"}, {"a1.png", "a2.png"}, {"1", "2"}};
  const CameraImages alone{"a", {dir / "a1.png"}, {"a1.png"}, {"1"}};
  const auto data = detect_dataset({both}, *make_target(kBoard)),
             one = detect_dataset({alone}, *make_target(kBoard));
  ASSERT_TRUE(data && one) << data.error().text();
  ASSERT_EQ(data->views[0].corners.size(), 35U);
  ASSERT_EQ(data->views[1].corners.size(), 35U);
  for (std::size_t k = 0; k < 35; ++k) {
    EXPECT_EQ(data->views[0].corners[k].px, one->views[0].corners[k].px);
    // Levels are rounded twice: 0.29 levels of 180 each, 0.01 px at most on a fit over a few hundred pixels.
    EXPECT_LT((data->views[0].corners[k].px - data->views[1].corners[k].px).norm(), 0.01);
  }
}

TEST(DetectDataset, OrientationTagsAreTold) {
  const TempDir dir;
  cv::imwrite(dir / "a1.jpg", shot(10, 5), {cv::IMWRITE_JPEG_QUALITY, 95});
  std::string bytes = read_text(dir / "a1.jpg");
  bytes.insert(2, std::string("\xFF\xE1\x00\x22"
                              "Exif\0\0MM\0\x2A\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0",
                              36));
  write_text(dir / "a2.jpg", bytes);
  const CameraImages camera{"a", {dir / "a1.jpg", dir / "a2.jpg"}, {"a1.jpg", "a2.jpg"}, {"1", "2"}};
  std::vector<std::string> notes;
  DetectOptions options;
  options.note = [&](const std::string& note) { notes.push_back(note); };
  const auto data = detect_dataset({camera}, *make_target(kBoard), options);
  ASSERT_TRUE(data) << data.error().text();
  EXPECT_THAT(notes,
              testing::ElementsAre(
                  "a: 1 of 2 images carries EXIF orientation 6 (to be turned by 90 degrees clockwise); "
                  "pixels are used as stored, also in the others (a1.jpg is one)"));
  ASSERT_EQ(data->views[1].corners.size(), 35U);  // the same pixels, so the same corners
  for (std::size_t k = 0; k < 35; ++k) EXPECT_EQ(data->views[0].corners[k].px, data->views[1].corners[k].px);

  using detail::orientation_note;
  const std::vector<std::string> names{"1", "2", "3", "4"};
  EXPECT_FALSE(orientation_note(std::array{1, 1, 1, 1}, names));
  EXPECT_EQ(
      *orientation_note(std::array{3, 3, 3, 3}, names),
      "4 of 4 images carry EXIF orientation 3 (to be turned by 180 degrees); pixels are used as stored");
  EXPECT_EQ(*orientation_note(std::array{1, 8, 8, 6}, names),
            "1 of 4 images carries EXIF orientation 1 (upright), 1 is one; 1 of 4 images carries EXIF "
            "orientation 6 (to be turned by 90 degrees clockwise), 4 is one; 2 of 4 images carry EXIF "
            "orientation 8 (to be turned by 270 degrees clockwise), 2 is one: the camera was turned between "
            "the images, and pixels are used as stored in all of them");
}

// Files that another program has turned have their sides exchanged.
TEST(DetectDataset, TurnedPixelsAreNamed) {
  const TempDir dir;
  cv::imwrite(dir / "a1.png", shot(10, 5));
  cv::Mat turned;
  cv::rotate(shot(10, 5), turned, cv::ROTATE_90_CLOCKWISE);
  cv::imwrite(dir / "a2.png", turned);
  const CameraImages camera{"a", {dir / "a1.png", dir / "a2.png"}, {"a1.png", "a2.png"}, {"1", "2"}};
  const auto data = detect_dataset({camera}, *make_target(kBoard));
  ASSERT_FALSE(data);
  EXPECT_THAT(data.error().message, testing::HasSubstr("another program has turned the pixels"));
}

}  // namespace
}  // namespace plumbline::test
