// SPDX-License-Identifier: Apache-2.0
#include "io/opencv_matrix.hpp"

#include <fmt/format.h>

#include "io/yaml.hpp"

namespace plumbline::io {

std::string opencv_matrix_text(std::string_view key, const std::vector<double>& row_major_values,
                               std::size_t rows) {
  return fmt::format("{}: !!opencv-matrix\n   rows: {}\n   cols: {}\n   dt: d\n   data: {}\n", key, rows,
                     row_major_values.size() / rows, yaml_numbers(row_major_values));
}

}  // namespace plumbline::io
