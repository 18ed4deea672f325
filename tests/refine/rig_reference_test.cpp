// SPDX-License-Identifier: Apache-2.0
// Real recordings of rigs, taken apart so that the answer is known from the whole.
#include <gtest/gtest.h>

#include <map>

#include "refine/rig_support.hpp"

namespace plumbline::test {
namespace {

const AprilGrid kGrid{.columns = 6, .rows = 6, .tag_m = 0.088, .spacing = 0.3};

// Both cameras' detections of EuRoC's recording, frames by time stamp.
Dataset read_stereo(const std::filesystem::path& dir) {
  Dataset data;
  data.targets = {*make_target(kGrid)};
  std::map<std::string, int> frame_of;
  for (const std::string cam : {"cam0", "cam1"}) {
    data.cameras.push_back({cam, {752, 480}});
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(dir / cam)) files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    for (std::size_t i = 0; i < files.size(); i += 2) {  // thirty frames are enough
      const auto& file = files[i];
      const auto [at, is_new] =
          frame_of.try_emplace(file.stem().string(), static_cast<int>(data.frames.size()));
      if (is_new) data.frames.push_back(at->first);
      View view{static_cast<int>(data.cameras.size()) - 1,
                at->second,
                cam + "/" + file.filename().string(),
                {},
                ""};
      for (const std::string& line : split(read_text(file), '\n')) {
        const auto words = split(line, ',');
        if (words.size() < 12 || line.starts_with('#')) continue;
        view.corners.push_back({4 * std::stoi(words[10]) + std::stoi(words[11]),
                                {std::stod(words[5]), std::stod(words[6])},
                                1.0});
      }
      std::sort(view.corners.begin(), view.corners.end(),
                [](const Corner& a, const Corner& b) { return a.point < b.point; });
      data.views.push_back(view);
    }
  }
  return data;
}

// The left camera keeps the left half of the board, the right camera the right half: two boards that no frame
// shows to the same camera. In truth the halves stand where they were printed, T_board0_board = I.
Dataset halved(const Dataset& whole) {
  Dataset data = whole;
  const auto half_of = [](int point) { return (point / 4) % kGrid.columns < kGrid.columns / 2 ? 0 : 1; };
  std::array<Points3d, 2> halves;
  std::map<int, int> index;
  for (int p = 0; p < static_cast<int>(whole.targets[0].points.size()); ++p) {
    auto& points = halves[half_of(p)].points_m;
    index[p] = static_cast<int>(points.size());
    points.push_back(whole.targets[0].points[p]);
  }
  data.targets = {*make_target(halves[0], "left_half"), *make_target(halves[1], "right_half")};
  for (View& view : data.views) {
    view.target = view.cam;
    std::erase_if(view.corners, [&](const Corner& c) { return half_of(c.point) != view.cam; });
    for (Corner& c : view.corners) c.point = index[c.point];
    if (view.corners.size() < 4) view.corners.clear();
  }
  return data;
}

TEST(RigReference, EurocIsTheSameFromTwoHalvesOfItsBoardByMotion) {
  const auto dir = data_dir("yac_euroc_april");
  PLUMBLINE_NEEDS(dir);
  const Dataset data = read_stereo(*dir / "imu_april");
  const RefineOptions options{.lenses = {"opencv4"}, .n_threads = 1};
  const auto whole = calibrate(data, options);
  ASSERT_TRUE(whole) << whole.error().text();
  const auto parts = calibrate(halved(data), options);
  ASSERT_TRUE(parts) << parts.error().text();
  EXPECT_TRUE(parts->provenance.options.contains("joined by motion"));
  const Vec6 rig = box_minus(parts->rig.T_cam_rig[1], whole->rig.T_cam_rig[1]);
  const Vec6 board = box_minus(parts->T_board0_board[1], SE3());
  // Half a board in each camera moves centre and focal length by some pixels of 460 (0.5 degrees); a
  // baseline of 110 mm to 3 %, and the halves, as printed, to 2 mm in 660.
  EXPECT_LT(rig.head<3>().norm(), 0.5 * kRadPerDeg);
  EXPECT_LT(rig.tail<3>().norm(), 0.003);
  EXPECT_LT(board.head<3>().norm(), 0.1 * kRadPerDeg);
  EXPECT_LT(board.tail<3>().norm(), 0.002);
}

}  // namespace
}  // namespace plumbline::test
