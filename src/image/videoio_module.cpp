// SPDX-License-Identifier: Apache-2.0
// The only code that links opencv_videoio; built as a module of its own (see imageio_api.hpp).
#include <algorithm>
#include <cmath>
#include <cstring>
#include <exception>
#include <limits>
#include <memory>
#include <opencv2/core/version.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "image/imageio_api.hpp"

namespace {

constexpr bool kIsTurnedWrongly = CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR == 6;

using Facts = plumbline::detail::VideoioApi::Facts;

void say(const char* text, char* message, std::size_t size) noexcept {
  if (size == 0) return;
  const std::size_t n = std::min(std::strlen(text), size - 1);
  std::memcpy(message, text, n);
  message[n] = 0;
}

int as_int(double value) {
  return value >= 0 && value < std::numeric_limits<int>::max() ? static_cast<int>(std::lround(value)) : 0;
}

void* open(const char* file, Facts* facts, char* message, std::size_t message_size) noexcept {
  try {
    auto video = std::make_unique<cv::VideoCapture>();
    // Files only: the other readers would take the name for a camera, a pattern or a pipeline.
    for (const int reader : {cv::CAP_FFMPEG, cv::CAP_OPENCV_MJPEG}) {
      if (!video->open(file, reader)) continue;
      // As with photographs, the pixels are those that are stored.
      video->set(cv::CAP_PROP_ORIENTATION_AUTO, 0);
      facts->width = as_int(video->get(cv::CAP_PROP_FRAME_WIDTH));
      facts->height = as_int(video->get(cv::CAP_PROP_FRAME_HEIGHT));
      facts->n_frames = as_int(video->get(cv::CAP_PROP_FRAME_COUNT));
      facts->rotation_deg = as_int(video->get(cv::CAP_PROP_ORIENTATION_META)) % 360;
      // OpenCV 4.6.0 gives it the wrong way round (its issue 22088).
      if (kIsTurnedWrongly) facts->rotation_deg = (360 - facts->rotation_deg) % 360;
      return video.release();
    }
    say("neither FFmpeg nor OpenCV can decode it", message, message_size);
  } catch (const std::exception& e) {
    say(e.what(), message, message_size);
  }
  return nullptr;
}

bool next(void* video) noexcept {
  try {
    return static_cast<cv::VideoCapture*>(video)->grab();
  } catch (const std::exception&) {
    return false;
  }
}

bool pixels(void* video, bool grey, cv::Mat* image, char* message, std::size_t message_size) noexcept {
  try {
    cv::Mat frame;
    if (!static_cast<cv::VideoCapture*>(video)->retrieve(frame) || frame.empty() || frame.depth() != CV_8U) {
      say("the frame has no 8-bit picture", message, message_size);
      return false;
    }
    if (grey && frame.channels() > 1)
      cv::cvtColor(frame, *image, cv::COLOR_BGR2GRAY);
    else
      *image = frame.clone();  // the decoder writes the next frame over this one
    return true;
  } catch (const std::exception& e) {
    say(e.what(), message, message_size);
  }
  return false;
}

void close(void* video) noexcept { delete static_cast<cv::VideoCapture*>(video); }

}  // namespace

extern "C" __attribute__((visibility("default"))) const plumbline::detail::VideoioApi plumbline_videoio_v1;
const plumbline::detail::VideoioApi plumbline_videoio_v1{open, next, pixels, close};
