// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "plumbline/detect/detect.hpp"

namespace plumbline::apps {

/// What the pictures of a camera are called, without an extension: the stems of their files ("left01",
/// "video_000120" for a frame of a video), and their frames where two are the same.
std::vector<std::string> picture_names(const CameraImages& images);

/// 8-bit BGR of any image, to draw in.
cv::Mat in_colour(const cv::Mat& image);

/// One line of text into a picture: its left end and its baseline, the height of a digit [px].
struct Label {
  cv::Point at;
  double height_px = 12;
  cv::Scalar colour;
  bool outlined = false;  ///< with a dark rim, so that it can be read on anything
};
void draw_text(cv::Mat& picture, const std::string& text, const Label& label);

/// The width of a line of text of this height [px].
int text_width(const std::string& text, double height_px);

/// Words in lines of at most `width_px`, and at most `most` lines; what is too long ends with "...".
std::vector<std::string> wrap_text(const std::string& text, double height_px, int width_px, std::size_t most);

}  // namespace plumbline::apps
