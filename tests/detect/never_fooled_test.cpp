// SPDX-License-Identifier: Apache-2.0
// Images in which the board is not: a wrong id is worse than a missing one.
#include <opencv2/imgproc.hpp>

#include "detect/data_sets.hpp"
#include "detect/render.hpp"
#include "plumbline/detect/detect.hpp"
#include "plumbline/image/image.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

std::vector<Target> one_of_each_kind() {
  return {*make_target(Chessboard{9, 6, 0.03}), *make_target(Charuco{8, 11, 0.03, 0.022}),
          *make_target(AprilGrid{6, 6, 0.088, 0.3}), *make_target(Circles{9, 7, 0.02}),
          *make_target(Circles{4, 11, 0.02, 0, true})};
}

/// Noise that is rough at every scale.
cv::Mat rough(cv::Size size) {
  cv::Mat out(size, CV_32F, cv::Scalar(128));
  cv::RNG rng(7);
  for (int cell = 1; cell <= 64; cell *= 2) {
    cv::Mat coarse(size.height / cell + 1, size.width / cell + 1, CV_32F), fine;
    rng.fill(coarse, cv::RNG::NORMAL, 0, 25);
    cv::resize(coarse, fine, size, 0, 0, cv::INTER_LINEAR);
    out += fine;
  }
  out.convertTo(out, CV_8U);
  return out;
}

/// A shirt's stripes, two layers of them with folds.
cv::Mat shirt(cv::Size size) {
  cv::Mat out(size, CV_8U);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const double u = x + 12 * std::sin(y / 60.0), v = y + 9 * std::sin(x / 45.0);
      const bool dark = (static_cast<int>(u / 14) % 2 == 0) != (static_cast<int>(v / 90) % 2 == 0 && x > 330);
      out.at<unsigned char>(y, x) = dark ? 60 : 190;
    }
  }
  cv::GaussianBlur(out, out, cv::Size(), 0.8);
  return out;
}

cv::Mat page(cv::Size size) {
  cv::Mat out(size, CV_8U, cv::Scalar(235));
  const std::string line = "HEXHLIT#EOFTBDQAX8WMNKHI EFL##HHH%% XIXIX 0O0O HTE";
  for (int y = 24, k = 0; y < size.height; y += 26, ++k)
    cv::putText(out, line.substr(static_cast<std::size_t>(k) % 9), {10, y}, cv::FONT_HERSHEY_SIMPLEX, 0.8, 30,
                2, cv::LINE_AA);
  return out;
}

TEST(NeverFooled, NoiseStripesAndText) {
  const cv::Size size(640, 400);
  const std::vector<std::pair<std::string, cv::Mat>> images{
      {"noise", rough(size)}, {"shirt", shirt(size)}, {"text", page(size)}};
  for (const auto& [name, image] : images) {
    for (const Target& target : one_of_each_kind()) {
      const Detection d = *detect_target(image, target);
      EXPECT_TRUE(d.corners.empty()) << target.name << " in " << name << ": " << d.corners.size();
      EXPECT_FALSE(d.reason.empty());
    }
  }
}

// Photographs of chessboards are searched for those of all other counts: smaller and larger ones, half out of
// the image, in rooms full of other things.
TEST(NeverFooled, ChessboardsOfOtherCounts) {
  std::vector<Target> targets;
  for (const DataSet& set : data_sets()) {
    const auto* board = std::get_if<Chessboard>(&set.spec);
    const auto has = [&](const Target& t) { return t.spec == set.spec; };
    if (board && std::none_of(targets.begin(), targets.end(), has)) targets.push_back(*make_target(set.spec));
  }
  int searched = 0;
  for (const DataSet& set : data_sets()) {
    if (!std::holds_alternative<Chessboard>(set.spec)) continue;
    const auto folder = data_dir(set.folder);
    PLUMBLINE_NEEDS(folder);
    const auto files = images_of(*folder, set.pattern);
    for (const std::size_t i : {std::size_t{0}, files.size() / 2}) {
      const cv::Mat grey = *read_image_grey(files[i]);
      for (const Target& target : targets) {
        if (target.spec == set.spec) continue;
        ++searched;
        EXPECT_TRUE(detect_target(grey, target)->corners.empty()) << target.name << " in " << files[i];
      }
    }
  }
  EXPECT_GT(searched, 400);
}

// A 13x9 board looks the same after a half turn. In these photographs one of its rows is outside of the
// image, and what lies beside its other end must not be taken for it.
TEST(NeverFooled, SymmetricBoardsHalfOut) {
  const Target target = *make_target(Chessboard{13, 9, 0.025});
  for (const std::string camera : {"left", "middle", "right"}) {
    const auto folder = data_dir("boofcv_calibration/trinocular/" + camera);
    PLUMBLINE_NEEDS(folder);
    for (const std::string number : {"25", "27"}) {
      const cv::Mat grey = *read_image_grey(*folder / (camera + number + ".jpg"));
      EXPECT_TRUE(detect_target(grey, target)->corners.empty()) << camera << number;
    }
  }
}

// Grids of circles hold smaller grids, and squares are dark blobs too.
TEST(NeverFooled, CirclesOfOtherCounts) {
  std::vector<Target> targets;
  for (const DataSet& set : data_sets()) {
    if (std::holds_alternative<Circles>(set.spec)) targets.push_back(*make_target(set.spec));
  }
  int searched = 0;
  for (const DataSet& set : data_sets()) {
    const bool is_other = set.pattern == "chess9.png" || set.folder.ends_with("calib-3_stereo_from_JY/right");
    if (!std::holds_alternative<Circles>(set.spec) && !is_other) continue;
    const auto folder = data_dir(set.folder);
    PLUMBLINE_NEEDS(folder);
    const auto files = images_of(*folder, set.pattern);
    const cv::Mat grey = *read_image_grey(files[is_other ? 2 * files.size() / 3 : 0]);
    for (const Target& target : targets) {
      if (target.spec == set.spec) continue;
      ++searched;
      EXPECT_TRUE(detect_target(grey, target)->corners.empty()) << target.name << " in " << set.folder;
    }
  }
  EXPECT_GE(searched, 28);
}

// A photograph of each set is searched for the marker boards of all other sets: the same dictionaries and
// families on boards of other counts among them.
TEST(NeverFooled, MarkerBoardsOfOtherSets) {
  std::vector<Target> targets;
  for (const DataSet& set : data_sets()) {
    const bool has_markers =
        std::holds_alternative<Charuco>(set.spec) || std::holds_alternative<AprilGrid>(set.spec);
    const auto has = [&](const Target& t) { return t.spec == set.spec; };
    if (has_markers && std::none_of(targets.begin(), targets.end(), has))
      targets.push_back(*make_target(set.spec));
  }
  int searched = 0;
  for (const DataSet& set : data_sets()) {
    const auto folder = data_dir(set.folder);
    PLUMBLINE_NEEDS(folder);
    const auto files = images_of(*folder, set.pattern);
    const cv::Mat grey = *read_image_grey(files[files.size() / 2]);
    for (const Target& target : targets) {
      if (target.spec == set.spec) continue;
      ++searched;
      EXPECT_TRUE(detect_target(grey, target)->corners.empty()) << target.name << " in " << set.folder;
    }
  }
  EXPECT_GT(searched, 200);
}

}  // namespace
}  // namespace plumbline::test
