// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/rectification_io.hpp"

#include <fmt/format.h>

#include "io/opencv_matrix.hpp"
#include "io/yaml.hpp"

namespace plumbline {

std::string format_rectification(const StereoRectification& r) {
  const auto matrix = [](const char* key, const MatX& M) {
    return io::opencv_matrix_text(key, io::row_major(M), static_cast<std::size_t>(M.rows()));
  };
  return io::kOpencvHeader + fmt::format("image_width: {}\nimage_height: {}\n", r.size.width, r.size.height) +
         matrix("R1", r.R_rect_cam[0]) + matrix("R2", r.R_rect_cam[1]) + matrix("P1", r.P[0]) +
         matrix("P2", r.P[1]) + matrix("Q", r.Q);
}

}  // namespace plumbline
