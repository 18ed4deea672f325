// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "detect/markers.hpp"
#include "detect/planar.hpp"
#include "plumbline/detect/detect.hpp"

namespace plumbline::detail {

/// The board's corners from the markers of its dictionary that are in the image (other boards' ids are left
/// alone).
Detection charuco_from_markers(const cv::Mat& grey, const Charuco& board, const std::vector<Marker>& markers);

/// Whether the board looks different under the two layouts and the target leaves open which it is.
inline bool has_open_layout(const Charuco& board) {
  return board.layout == Charuco::Layout::kAuto && board.rows % 2 == 0;
}

/// Detection::layout_vote of these markers; 0 unless has_open_layout.
int layout_vote(const Charuco& board, const std::vector<Marker>& markers);

/// The target with its open layouts set to `layout`; nullopt when it has none.
std::optional<Target> with_layout(const Target& target, Charuco::Layout layout);

/// The tag corners of an AprilGrid from the tags in the image.
Detection aprilgrid_from_tags(const cv::Mat& grey, const AprilGrid& board, const std::vector<Marker>& tags);

/// Number of markers of a ChArUco board.
inline int n_markers(const Charuco& board) { return board.columns * board.rows / 2; }

}  // namespace plumbline::detail
