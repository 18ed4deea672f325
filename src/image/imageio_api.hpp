// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <opencv2/core/mat.hpp>

/// What plumbline_imageio.so (imageio_module.cpp) and plumbline_videoio.so (videoio_module.cpp) offer. They
/// are loaded by codec.cpp when the first image or video is read, because linking opencv_imgcodecs costs
/// every process start its 140 libraries, and opencv_videoio with FFmpeg another 100. No exception crosses
/// them.
namespace plumbline::detail {

inline constexpr const char* kImageioFile = "plumbline_imageio.so";
inline constexpr const char* kImageioSymbol = "plumbline_imageio_v2";

struct ImageioApi {
  /// Decodes `bytes` with the numbers that the file has (grey, or grey or BGR as it is). On failure the
  /// reason stands in `message`.
  bool (*decode)(const unsigned char* bytes, std::size_t size, bool grey, cv::Mat* image, char* message,
                 std::size_t message_size) noexcept;
  /// PNG bytes of an 8- or 16-bit image as a 1xN matrix.
  bool (*encode_png)(const cv::Mat* image, cv::Mat* bytes, char* message, std::size_t message_size) noexcept;
};

inline constexpr const char* kVideoioFile = "plumbline_videoio.so";
inline constexpr const char* kVideoioSymbol = "plumbline_videoio_v1";

struct VideoioApi {
  struct Facts {
    int width = 0, height = 0;
    int n_frames = 0;      ///< as the container says, which may be wrong; 0: not said
    int rotation_deg = 0;  ///< clockwise, to see it upright
  };
  /// A decoder that stands before the first frame; nullptr with the reason in `message`.
  void* (*open)(const char* file, Facts* facts, char* message, std::size_t message_size) noexcept;
  /// Goes on by one frame; false at the end and where nothing more can be decoded.
  bool (*next)(void* video) noexcept;
  /// The pixels of the frame it is at: 8-bit, grey or BGR.
  bool (*pixels)(void* video, bool grey, cv::Mat* image, char* message, std::size_t message_size) noexcept;
  void (*close)(void* video) noexcept;
};

}  // namespace plumbline::detail
