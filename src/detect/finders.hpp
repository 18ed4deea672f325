// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core/mat.hpp>

#include "plumbline/detect/detect.hpp"

/// One finder for each kind of target; all thread-safe, none throws for what an image may hold.
namespace plumbline::detail {

Detection detect_chessboard(const cv::Mat& grey, const Chessboard& board);
Detection detect_circles(const cv::Mat& grey, const Circles& board);
Detection detect_charuco(const cv::Mat& grey, const Charuco& board);
Detection detect_aprilgrid(const cv::Mat& grey, const AprilGrid& board);
Result<Detection> detect_rig(const cv::Mat& grey, const BoardRig& rig, const Target& target);

}  // namespace plumbline::detail
