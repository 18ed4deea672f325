// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/rig/dataset.hpp"

/// Which cameras and boards hang together. Two cameras do when both see the same board (or boards that hang
/// together) in one frame; two boards do when the same camera (or cameras that hang together) sees both in
/// one frame; and so on until nothing changes. What is left is tied by motion alone: cameras and boards of
/// two groups of which in several frames one camera sees its board and the other its own.
namespace plumbline::detail {

/// A board seen by a camera.
struct Sight {
  int cam = 0, frame = 0, target = 0;
};

/// Groups by their lowest member.
struct RigGroups {
  std::vector<int> of_cam, of_board;
};
constexpr int kLeastMotionFrames = 3;  ///< two turns

RigGroups rig_groups(int n_cams, int n_boards, const std::vector<Sight>& sights, bool by_motion);

/// A frame without which the cameras no longer hang together, and the cameras that it ties to the first one's
/// group. None where they do not hang together anyway.
struct Bridge {
  int frame = 0;
  std::vector<int> cams;
};
std::vector<Bridge> bridges(int n_cams, int n_boards, const std::vector<Sight>& sights);

/// kDegenerate for cameras in several groups: names the groups with their boards, says which frames nearly
/// join them (both took an image, one did not find the board) and what to photograph. `motion` is what
/// hand_eye() said, or empty.
Error gap_error(const Dataset& data, const std::vector<Sight>& sights, const RigGroups& groups,
                const std::string& motion);

}  // namespace plumbline::detail
