// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <opencv2/core/mat.hpp>

#include "plumbline/core/result.hpp"

namespace plumbline {

/// An image file as 8-bit grey. kIo: missing or unreadable; kParse: the file is there but is no image that
/// can be decoded.
Result<cv::Mat> read_image_grey(const std::filesystem::path& file);

/// An image file as it is: 8-bit grey or BGR. Failures as above.
Result<cv::Mat> read_image(const std::filesystem::path& file);

/// Writes a PNG; kIo when that fails (a full disc among others), and then no file is left.
Status write_png(const std::filesystem::path& file, const cv::Mat& image);

}  // namespace plumbline
