// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <string_view>
#include <vector>

namespace plumbline::io {

/// The first lines of every file that cv::FileStorage reads.
inline constexpr const char* kOpencvHeader = "%YAML:1.0\n---\n";

/// `key: !!opencv-matrix ...` as cv::FileStorage reads it; 17 digits.
std::string opencv_matrix_text(std::string_view key, const std::vector<double>& row_major_values,
                               std::size_t rows);

}  // namespace plumbline::io
