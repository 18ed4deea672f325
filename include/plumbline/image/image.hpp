// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <functional>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "plumbline/core/result.hpp"

/// Images are files (JPEG, PNG, TIFF, BMP, PGM, PPM, WebP and what else Debian's OpenCV decodes) and frames
/// of videos, whose path is that of the video, '#' and the number of the frame (video.hpp). Pixels are always
/// those that are stored: an orientation tag is told and not applied, because a calibration belongs to the
/// sensor's pixels, and an alpha channel is left out.
namespace plumbline {

enum class ReadAs {
  kGrey8,   ///< 8-bit grey; what has more bits or other numbers goes through to_8bit()
  kStored,  ///< grey or BGR, of 8 or 16 bits; what has other numbers goes through to_8bit()
};

/// The pixels of an image, and what its file says of them.
struct Photograph {
  cv::Mat pixels;
  /// EXIF's tag 0x0112, 1..8: how to turn the picture to see it upright; 1 where the file says nothing. A
  /// video that is to be turned by 90, 180 or 270 degrees clockwise gives 6, 3 or 8.
  int orientation = 1;
};

/// kIo: missing or unreadable; kParse: the file is there but is no image that can be decoded, or it is cut.
/// A frame of a video is reached by decoding all that come before it, which is exact and takes its time:
/// for_each_image() reads many in one go.
Result<Photograph> read_photograph(const std::filesystem::path& file, ReadAs as);

/// The pixels of read_photograph() as 8-bit grey.
Result<cv::Mat> read_image_grey(const std::filesystem::path& file);

/// The pixels of read_photograph() as they are stored.
Result<cv::Mat> read_image(const std::filesystem::path& file);

/// Calls body(i, photograph or why there is none) once for each file, from up to `n_threads` threads (<= 0:
/// all cores), in no particular order. A video is decoded once from its beginning to the last frame that is
/// asked for. No more images are in memory than threads, and one for each video.
void for_each_image(const std::vector<std::filesystem::path>& files, ReadAs as, int n_threads,
                    const std::function<void(int, const Result<Photograph>&)>& body);

/// An 8-bit image of any other: the grey levels from the darkest to the brightest pixel become 0 to 255 by
/// one affine map for all channels, where one in 10000 pixels at each end does not count (dead and hot
/// pixels) and no level is stretched to more than one. So 12 bits in 16 and thermal images use all levels,
/// and the result depends on nothing but the image. NaN becomes 0. 8-bit images come back as they are.
cv::Mat to_8bit(const cv::Mat& image);

/// Writes a PNG; kIo when that fails (a full disc among others), and then no file is left.
Status write_png(const std::filesystem::path& file, const cv::Mat& image);

}  // namespace plumbline
