// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <opencv2/core/mat.hpp>

/// What plumbline_imageio.so (imageio_module.cpp) offers. It is loaded by codec.cpp when the first image is
/// read, because linking opencv_imgcodecs costs every process start its 200 and more libraries. No exception
/// crosses it.
namespace plumbline::detail {

inline constexpr const char* kImageioFile = "plumbline_imageio.so";
inline constexpr const char* kImageioSymbol = "plumbline_imageio_v1";

struct ImageioApi {
  /// Decodes `bytes` (grey, or as the file is: 8-bit grey or BGR). On failure the reason stands in `message`.
  bool (*decode)(const unsigned char* bytes, std::size_t size, bool grey, cv::Mat* image, char* message,
                 std::size_t message_size) noexcept;
  /// PNG bytes of an 8- or 16-bit image as a 1xN matrix.
  bool (*encode_png)(const cv::Mat* image, cv::Mat* bytes, char* message, std::size_t message_size) noexcept;
};

}  // namespace plumbline::detail
