// SPDX-License-Identifier: Apache-2.0
// The only code that links opencv_imgcodecs; built as a module of its own (see imageio_api.hpp).
#include <algorithm>
#include <cstring>
#include <exception>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "image/imageio_api.hpp"

namespace {

void say(const char* text, char* message, std::size_t size) noexcept {
  if (size == 0) return;
  const std::size_t n = std::min(std::strlen(text), size - 1);
  std::memcpy(message, text, n);
  message[n] = 0;
}

bool decode(const unsigned char* bytes, std::size_t size, bool grey, cv::Mat* image, char* message,
            std::size_t message_size) noexcept {
  try {
    // IMREAD_ANYCOLOR keeps grey as grey. The photograph's own orientation tag is not applied: a calibration
    // belongs to the sensor's pixels as they are stored.
    const int flags = (grey ? cv::IMREAD_GRAYSCALE : cv::IMREAD_ANYCOLOR) | cv::IMREAD_ANYDEPTH |
                      cv::IMREAD_IGNORE_ORIENTATION;
    const cv::Mat encoded(1, static_cast<int>(size), CV_8U, const_cast<unsigned char*>(bytes));
    *image = cv::imdecode(encoded, flags);
    if (!image->empty()) return true;
    say("no codec of OpenCV can decode it", message, message_size);
  } catch (const std::exception& e) {
    say(e.what(), message, message_size);
  }
  return false;
}

bool encode_png(const cv::Mat* image, cv::Mat* bytes, char* message, std::size_t message_size) noexcept {
  try {
    std::vector<unsigned char> buffer;
    if (cv::imencode(".png", *image, buffer)) {
      *bytes = cv::Mat(buffer, true).reshape(1, 1);
      return true;
    }
    say("OpenCV cannot encode it as PNG", message, message_size);
  } catch (const std::exception& e) {
    say(e.what(), message, message_size);
  }
  return false;
}

}  // namespace

extern "C" __attribute__((visibility("default"))) const plumbline::detail::ImageioApi plumbline_imageio_v2;
const plumbline::detail::ImageioApi plumbline_imageio_v2{decode, encode_png};
