// SPDX-License-Identifier: Apache-2.0
// White box: which cameras and boards hang together.
#include "refine/rig_graph.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "plumbline/core/random.hpp"

namespace plumbline::test {
namespace {

using namespace detail;
using ::testing::ElementsAre;

TEST(RigGraph, SightJoinsCamerasAndBoards) {
  // Frame 0: cameras 0 and 1 see board 0. Frame 1: camera 1 sees boards 0 and 1. Frame 2: camera 2 sees board
  // 1 while camera 0 sees board 0: the boards are joined by then, and with them the cameras.
  const std::vector<Sight> sights{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {1, 1, 1}, {2, 2, 1}, {0, 2, 0}};
  const RigGroups groups = rig_groups(4, 3, sights, false);
  EXPECT_THAT(groups.of_cam, ElementsAre(0, 0, 0, 3));
  EXPECT_THAT(groups.of_board, ElementsAre(0, 0, 2));
  // Without the frame that joins the boards camera 2 falls off; without frame 0 camera 1 does: it alone ties
  // the boards, and camera 2 shares with it what it shares with camera 0, nothing.
  const std::vector<Sight> three{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {1, 1, 1}, {2, 2, 1}, {0, 2, 0}};
  const auto found = bridges(3, 2, three);
  ASSERT_EQ(found.size(), 3u);
  EXPECT_EQ(found[0].frame, 0);
  EXPECT_THAT(found[0].cams, ElementsAre(1));
  EXPECT_EQ(found[1].frame, 1);
  EXPECT_THAT(found[1].cams, ElementsAre(2));
  EXPECT_EQ(found[2].frame, 2);
  EXPECT_THAT(found[2].cams, ElementsAre(2));
}

TEST(RigGraph, MotionNeedsThreeFrames) {
  std::vector<Sight> sights;
  for (int f = 0; f < 2; ++f) {
    sights.push_back({0, f, 0});
    sights.push_back({1, f, 1});
  }
  EXPECT_THAT(rig_groups(2, 2, sights, true).of_cam, ElementsAre(0, 1));
  EXPECT_TRUE(bridges(2, 2, sights).empty());  // they do not hang together: no frame is to blame
  sights.push_back({0, 7, 0});
  sights.push_back({1, 7, 1});
  EXPECT_THAT(rig_groups(2, 2, sights, true).of_cam, ElementsAre(0, 0));
  EXPECT_THAT(rig_groups(2, 2, sights, true).of_board, ElementsAre(0, 0));
  EXPECT_THAT(rig_groups(2, 2, sights, false).of_cam, ElementsAre(0, 1));
  EXPECT_EQ(bridges(2, 2, sights).size(), 3u);
}

// Halving finds what leaving out each frame in turn finds.
TEST(RigGraph, BridgesAreThoseOfTheDefinition) {
  Rng rng(1);
  int n_found = 0;
  for (int trial = 0; trial < 300; ++trial) {
    std::vector<Sight> sights;
    const int n_frames = 3 + trial % 6;
    for (int f = 0; f < n_frames; ++f) {
      for (int cam = 0; cam < 4; ++cam) {
        for (int board = 0; board < 2; ++board) {
          if (rng.uniform() < 0.3) sights.push_back({cam, f, board});
        }
      }
    }
    const auto together = [](const std::vector<Sight>& some) {
      const RigGroups groups = rig_groups(4, 2, some, true);
      return std::count(groups.of_cam.begin(), groups.of_cam.end(), 0) == 4;
    };
    std::vector<int> expected, found;
    for (int f = 0; f < n_frames && together(sights); ++f) {
      std::vector<Sight> others = sights;
      std::erase_if(others, [&](const Sight& s) { return s.frame == f; });
      if (!together(others)) expected.push_back(f);
    }
    for (const Bridge& bridge : bridges(4, 2, sights)) found.push_back(bridge.frame);
    EXPECT_EQ(found, expected) << trial;
    n_found += static_cast<int>(found.size());
  }
  EXPECT_GT(n_found, 50);
}

}  // namespace
}  // namespace plumbline::test
