// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "detect/markers.hpp"
#include "detect/planar.hpp"
#include "plumbline/detect/detect.hpp"

namespace plumbline::detail {

/// The board's corners from the markers of its dictionary that are in the image (other boards' ids are left
/// alone).
Detection charuco_from_markers(const cv::Mat& grey, const Charuco& board, const std::vector<Marker>& markers);

/// The tag corners of an AprilGrid from the tags in the image.
Detection aprilgrid_from_tags(const cv::Mat& grey, const AprilGrid& board, const std::vector<Marker>& tags);

/// Number of markers of a ChArUco board.
inline int n_markers(const Charuco& board) { return board.columns * board.rows / 2; }

}  // namespace plumbline::detail
