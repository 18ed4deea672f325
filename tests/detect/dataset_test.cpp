// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <fstream>
#include <opencv2/core.hpp>

#include "detect/data_sets.hpp"
#include "detect/render.hpp"
#include "plumbline/detect/detect.hpp"
#include "plumbline/image/image.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

const Chessboard kBoard{7, 5, 0.025};

/// Images of one camera; the name "3" is the file 3.png and the frame "3".
CameraImages camera_of(const TempDir& dir, const std::string& camera, const std::vector<std::string>& names) {
  CameraImages out{camera, {}, {}, {}};
  for (const std::string& name : names) {
    out.files.push_back(dir / (camera + name + ".png"));
    out.names.push_back(camera + name + ".png");
    out.frames.push_back(name);
  }
  return out;
}

void draw(const TempDir& dir, const std::string& name, double roll) {
  Render how;
  how.samples = 2;
  ASSERT_TRUE(write_png(dir / name,
                        render(look_at(*make_target(kBoard), 10, 5, roll), chessboard_shade(kBoard), how)));
}

TEST(DetectDataset, ViewsFramesAndReasons) {
  const TempDir dir;
  for (const char* name : {"a1.png", "a10.png", "b2.png", "b1.png"}) draw(dir, name, 5);
  ASSERT_TRUE(write_png(dir / "a2.png", cv::Mat(480, 640, CV_8U, cv::Scalar(90))));
  const Target target = *make_target(kBoard);
  const std::vector<CameraImages> cameras = {camera_of(dir, "a", {"10", "2", "1"}),
                                             camera_of(dir, "b", {"1", "2"})};
  DetectOptions options;
  std::vector<int> progress;
  options.progress = [&](int done, int all) {
    EXPECT_EQ(all, 5);
    progress.push_back(done);
  };
  const auto data = detect_dataset(cameras, target, options);
  ASSERT_TRUE(data) << data.error().text();
  EXPECT_THAT(progress, testing::ElementsAre(1, 2, 3, 4, 5));
  EXPECT_THAT(data->frames, testing::ElementsAre("1", "2", "10"));
  ASSERT_EQ(data->views.size(), 5U);
  std::vector<std::string> names;
  for (const View& v : data->views) {
    names.push_back(v.image);
    EXPECT_EQ(v.corners.empty(), !v.reason.empty()) << v.image;
  }
  EXPECT_THAT(names, testing::ElementsAre("a1.png", "a2.png", "a10.png", "b1.png", "b2.png"));
  EXPECT_EQ(data->views[2].frame, 2);
  EXPECT_EQ(data->views[3].frame, 0);
  EXPECT_EQ(data->views[1].reason, "no 7x5 chessboard found in 640x480 pixels");
  EXPECT_EQ(data->cameras[0].size, (ImageSize{640, 480}));
  EXPECT_EQ(data->detector, "chessboard: saddle fit");
  EXPECT_TRUE(validate(*data));

  options.n_threads = 1;
  options.progress = nullptr;
  const auto again = detect_dataset(cameras, target, options);
  ASSERT_TRUE(again);
  for (std::size_t i = 0; i < data->views.size(); ++i) {
    for (std::size_t k = 0; k < data->views[i].corners.size(); ++k) {
      EXPECT_EQ(data->views[i].corners[k].px, again->views[i].corners[k].px);
      EXPECT_EQ(data->views[i].corners[k].sigma_px, again->views[i].corners[k].sigma_px);
    }
  }
}

TEST(DetectDataset, FailuresNameTheImage) {
  const TempDir dir;
  draw(dir, "a1.png", 5);
  const Target target = *make_target(kBoard);
  write_text(dir / "a2.png", "no image");
  const auto undecodable = detect_dataset({camera_of(dir, "a", {"1", "2"})}, target);
  ASSERT_FALSE(undecodable);
  EXPECT_EQ(undecodable.error().code, ErrorCode::kParse);
  EXPECT_EQ(undecodable.error().where, "a2.png");

  ASSERT_TRUE(write_png(dir / "a2.png", cv::Mat(100, 200, CV_8U, cv::Scalar(90))));
  const auto sizes = detect_dataset({camera_of(dir, "a", {"1", "2"})}, target);
  ASSERT_FALSE(sizes);
  EXPECT_EQ(sizes.error().code, ErrorCode::kInvalidData);
  EXPECT_THAT(sizes.error().text(),
              testing::AllOf(testing::HasSubstr("200x100"), testing::HasSubstr("640x480")));

  const auto nothing = detect_dataset({camera_of(dir, "a", {"1"})}, *make_target(Chessboard{9, 6, 0.025}));
  ASSERT_FALSE(nothing);
  EXPECT_EQ(nothing.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(nothing.error().message, testing::HasSubstr("none of the 1 images"));
}

TEST(DetectDataset, SearchesEveryImageForEveryBoard) {
  const TempDir dir;
  const Chessboard other{9, 6, 0.02};
  Render how;
  how.samples = 2;
  const cv::Mat a = render(look_at(*make_target(kBoard), 10, 5, 5), chessboard_shade(kBoard), how);
  const cv::Mat b = render(look_at(*make_target(other), -8, 5, 0), chessboard_shade(other), how);
  cv::Mat both, one;
  cv::hconcat(a, b, both);
  cv::hconcat(a, cv::Mat(a.size(), a.type(), cv::Scalar(90)), one);
  ASSERT_TRUE(write_png(dir / "c1.png", both));
  ASSERT_TRUE(write_png(dir / "c2.png", one));
  const std::vector<Target> targets{*make_target(kBoard), *make_target(other)};
  const auto data = detect_dataset({camera_of(dir, "c", {"1", "2"})}, targets);
  ASSERT_TRUE(data) << data.error().text();
  ASSERT_EQ(data->views.size(), 4U);
  EXPECT_TRUE(validate(*data));
  for (int v = 0; v < 4; ++v) {
    EXPECT_EQ(data->views[v].frame, v / 2);
    EXPECT_EQ(data->views[v].target, v % 2);
    EXPECT_EQ(data->views[v].corners.size(), v == 3 ? 0U : targets[v % 2].points.size()) << v;
  }
  EXPECT_FALSE(data->views[3].reason.empty());
  for (const Corner& c : data->views[0].corners) EXPECT_LT(c.px.x(), a.cols);
  for (const Corner& c : data->views[1].corners) EXPECT_GT(c.px.x(), a.cols);
  EXPECT_THAT(data->detector, testing::HasSubstr("chessboard_9x6_20mm: "));

  const auto twice = detect_dataset({camera_of(dir, "c", {"1", "2"})}, {targets[0], targets[0]});
  ASSERT_FALSE(twice);
  EXPECT_EQ(twice.error().code, ErrorCode::kInvalidData);
  const auto absent = detect_dataset({camera_of(dir, "c", {"2"})}, targets);
  ASSERT_FALSE(absent);
  EXPECT_THAT(absent.error().text(), testing::HasSubstr("target chessboard_9x6_20mm: it is in no image"));
}

// All photographs of the demo, in both folders' common form.
TEST(DetectData, DemoPhotographs) {
  const auto folder = demo_images();
  PLUMBLINE_NEEDS(folder);
  std::vector<CameraImages> cameras;
  for (const std::string camera : {"left", "right"}) {
    CameraImages images{camera, images_of(*folder, camera + "[0-9]+\\.jpg"), {}, {}};
    for (const auto& file : images.files) {
      images.names.push_back(file.filename().string());
      images.frames.push_back(file.stem().string().substr(camera.size()));
    }
    cameras.push_back(images);
  }
  const auto data = detect_dataset(cameras, *make_target(Chessboard{9, 6, 0.025}));
  ASSERT_TRUE(data) << data.error().text();
  EXPECT_EQ(data->views.size(), 26U);
  EXPECT_EQ(data->frames.size(), 13U);
  for (const View& v : data->views) EXPECT_EQ(v.corners.size(), 54U) << v.image << v.reason;
  EXPECT_EQ(data->detector, "chessboard: saddle fit");
}

/// A selection of the data sets: at most a few images of each, so that the suite stays short. The whole is
/// the detection table (data_table_test.cpp).
TEST(DetectData, CountsOfTheCatalogue) {
  const std::vector<std::pair<std::string, int>> selection = {{"calib-3_stereo_from_JY/left", 4},
                                                              {"subpixel", 3},
                                                              {"negative", 1},
                                                              {"omnidir", 2},
                                                              {"Bumblebee2", 4},
                                                              {"boofcv_calibration/fisheye", 4},
                                                              {"camodocal", 4},
                                                              {"pyocamcalib", 3},
                                                              {"lifecam_480", 3},
                                                              {"wpical", 1},
                                                              {"post_optimization/cam_0", 2},
                                                              {"intrinsic_calib_charuco", 2},
                                                              {"CircleRegular", 2},
                                                              {"calibrationSquaresImg/lifecam", 2}};
  for (const DataSet& set : data_sets()) {
    const auto chosen = std::find_if(selection.begin(), selection.end(), [&](const auto& s) {
      return set.folder.find(s.first) != std::string::npos;
    });
    if (chosen == selection.end()) continue;
    const auto folder = data_dir(set.folder);
    PLUMBLINE_NEEDS(folder);
    auto files = images_of(*folder, set.pattern);
    if (set.found == set.images) files.resize(std::min<std::size_t>(files.size(), chosen->second));
    int found = 0;
    for (const auto& file : files) {
      const auto grey = read_image_grey(file);
      ASSERT_TRUE(grey) << grey.error().text();
      found += detect_target(*grey, *make_target(set.spec))->corners.empty() ? 0 : 1;
    }
    EXPECT_GE(found, std::min<int>(static_cast<int>(files.size()), set.found)) << set.folder;
  }
}

// Wide fisheye frames: the catalogue counts tags that OpenCV's aruco alone finds (29, 35, 17, 15); 36 tags
// are on the board.
TEST(DetectData, AprilGridOnFisheye) {
  const auto folder = data_dir("aprilgrid_rs/tests/data");
  PLUMBLINE_NEEDS(folder);
  const Target target = *make_target(AprilGrid{6, 6, 0.088, 0.3});
  for (const auto& [name, tags] :
       {std::pair{"TUM_VI.png", 36}, {"r45.png", 35}, {"right.png", 20}, {"top.png", 24}}) {
    const auto grey = read_image_grey(*folder / name);
    ASSERT_TRUE(grey);
    EXPECT_GE(detect_target(*grey, target)->corners.size(), static_cast<std::size_t>(4 * tags)) << name;
  }
}

// The truth files come from OpenCV's own finder at another time: agreement to a few tenths of a pixel.
TEST(DetectData, CircleCentresOfOpenCv) {
  const auto folder = data_dir("opencv_extra/cameracalibration/circles");
  PLUMBLINE_NEEDS(folder);
  for (int i = 1; i <= 8; ++i) {
    const auto grey = read_image_grey(*folder / fmt::format("circles{}.png", i));
    if (!grey) continue;
    cv::FileStorage file(*folder / fmt::format("circles_corners{}.dat", i), cv::FileStorage::READ);
    cv::Mat truth;
    file["corners"] >> truth;
    const auto d = detect_target(*grey, *make_target(Circles{truth.cols, truth.rows, 0.02}));
    ASSERT_TRUE(d);
    ASSERT_EQ(d->corners.size(), truth.total()) << i << d->reason;
    double sum = 0;
    for (const Corner& c : d->corners) {
      double nearest = 1e9;  // the file's numbering is a half turn of ours on some images
      for (std::size_t k = 0; k < truth.total(); ++k) {
        const auto& p = truth.ptr<cv::Point2f>()[k];
        nearest = std::min(nearest, (c.px - Vec2(p.x, p.y)).norm());
      }
      sum += nearest;
    }
    EXPECT_LT(sum / static_cast<double>(d->corners.size()), 0.3) << i;
  }
}

}  // namespace
}  // namespace plumbline::test
