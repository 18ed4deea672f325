// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/bundle_structure.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "plumbline/core/check.hpp"
#include "refine/bundle_setup.hpp"

namespace plumbline {
namespace {

using namespace detail;
using Kind = BundleStructure::Kind;

constexpr std::uint8_t kMixed = 4;
constexpr std::array<const char*, 5> kColours{"#ffffff", "#d95f02", "#1f5fa8", "#2a9d5c", "#8a8f98"};

std::uint8_t value_of(Kind kind) { return static_cast<std::uint8_t>(1 + static_cast<int>(kind)); }

// First scalar of each block, and the total at the end.
std::vector<long> offsets_of(const std::vector<int>& sizes) {
  std::vector<long> offsets{0};
  for (int size : sizes) offsets.push_back(offsets.back() + size);
  return offsets;
}

std::vector<long> column_offsets(const BundleStructure& s) {
  std::vector<int> sizes;
  for (const auto& column : s.columns) sizes.push_back(column.size);
  return offsets_of(sizes);
}

// A canvas onto which blocks of scalars are painted at the scale of the picture.
class Canvas {
 public:
  Canvas(long rows, long columns, int most_px) {
    image_.columns_per_px = std::max(1.0, static_cast<double>(columns) / most_px);
    image_.rows_per_px = std::max(1.0, static_cast<double>(rows) / most_px);
    image_.width = pixel(columns - 1, image_.columns_per_px) + 1;
    image_.height = pixel(rows - 1, image_.rows_per_px) + 1;
    image_.pixels.assign(static_cast<std::size_t>(image_.width) * image_.height, 0);
  }
  void paint(long row, long n_rows, long column, long n_columns, std::uint8_t value) {
    for (int y = pixel(row, image_.rows_per_px); y <= pixel(row + n_rows - 1, image_.rows_per_px); ++y) {
      for (int x = pixel(column, image_.columns_per_px);
           x <= pixel(column + n_columns - 1, image_.columns_per_px); ++x)
        image_.pixels[static_cast<std::size_t>(y) * image_.width + x] = value;
    }
  }
  StructureImage take() { return std::move(image_); }

 private:
  static int pixel(long scalar, double scalars_per_px) {
    return static_cast<int>(static_cast<double>(scalar) / scalars_per_px);
  }
  StructureImage image_;
};

}  // namespace

Result<BundleStructure> bundle_structure(const Reconstruction& start, const BundleOptions& options) {
  if (Status valid = validate(start); !valid) return valid.error();
  auto setup = make_setup(start, options);
  if (!setup) return setup.error();
  Reconstruction scene = start;
  const Participation part = participation_of(scene, *setup);
  if (part.n_sightings == 0)
    return Error{ErrorCode::kDegenerate,
                 "no sighting can be used; every point needs 2 views and every view 3 "
                 "such points",
                 "bundle"};
  if (Status fixed = fix_gauge(*setup, scene, part, options); !fixed) return fixed.error();

  BundleStructure structure;
  const auto add = [&](Kind kind, std::size_t index, int size, std::vector<int>& where) {
    where.push_back(size > 0 ? static_cast<int>(structure.columns.size()) : -1);
    if (size > 0) structure.columns.push_back({kind, static_cast<int>(index), size});
  };
  const SharedColumns shared = shared_columns(scene, *setup, part);
  std::vector<int> lens, view, point;
  for (std::size_t c = 0; c < scene.cameras.size(); ++c)
    add(Kind::kLens, c, shared.lens[c] >= 0 ? static_cast<int>(setup->lens_step[c].cols()) : 0, lens);
  for (std::size_t v = 0; v < scene.views.size(); ++v)
    add(Kind::kView, v, part.view[v] ? setup->view_steps(static_cast<int>(v)) : 0, view);
  for (std::size_t p = 0; p < scene.p_world.size(); ++p)
    add(Kind::kPoint, p, part.point[p] && !setup->point_held[p] ? 3 : 0, point);

  std::vector<const Sighting*> order;
  for (std::size_t i = 0; i < scene.sightings.size(); ++i)
    if (part.sighting[i]) order.push_back(&scene.sightings[i]);
  std::stable_sort(order.begin(), order.end(), [](const Sighting* a, const Sighting* b) {
    return std::pair(a->point, a->view) < std::pair(b->point, b->view);
  });
  const auto add_row = [&](std::initializer_list<int> columns, int size) {
    std::vector<int> row;
    for (int c : columns)
      if (c >= 0) row.push_back(c);
    std::sort(row.begin(), row.end());
    structure.rows.push_back(std::move(row));
    structure.row_size.push_back(size);
  };
  for (const Sighting* s : order)
    add_row({lens[scene.views[s->view].camera], view[s->view], point[s->point]}, 2);
  for (const ScaleBar& bar : setup->bars) add_row({point[bar.point_a], point[bar.point_b]}, 1);
  return structure;
}

StructureImage draw_jacobian(const BundleStructure& s, int most_px) {
  PLUMBLINE_CHECK(most_px > 0 && !s.rows.empty() && !s.columns.empty(), "a picture of something");
  const std::vector<long> rows = offsets_of(s.row_size), columns = column_offsets(s);
  Canvas canvas(rows.back(), columns.back(), most_px);
  for (std::size_t r = 0; r < s.rows.size(); ++r) {
    for (int c : s.rows[r])
      canvas.paint(rows[r], s.row_size[r], columns[c], s.columns[c].size, value_of(s.columns[c].kind));
  }
  return canvas.take();
}

StructureImage draw_normal_matrix(const BundleStructure& s, int most_px) {
  PLUMBLINE_CHECK(most_px > 0 && !s.columns.empty(), "a picture of something");
  const std::vector<long> columns = column_offsets(s);
  Canvas canvas(columns.back(), columns.back(), most_px);
  const auto paint = [&](int a, int b) {
    const bool same = s.columns[a].kind == s.columns[b].kind;
    canvas.paint(columns[a], s.columns[a].size, columns[b], s.columns[b].size,
                 same ? value_of(s.columns[a].kind) : kMixed);
  };
  for (const std::vector<int>& row : s.rows) {
    for (int a : row) {
      for (int b : row)
        if (a != b) paint(a, b);
    }
  }
  // The diagonal last: where a pixel holds many scalars, it is what must be seen.
  for (std::size_t c = 0; c < s.columns.size(); ++c) paint(static_cast<int>(c), static_cast<int>(c));
  return canvas.take();
}

namespace {

// Where a picture stands in the drawing, and how many units a pixel has.
struct Panel {
  const StructureImage& image;
  double left = 0, top = 0, zoom_x = 1, zoom_y = 1;
  double width() const { return zoom_x * image.width; }
  double height() const { return zoom_y * image.height; }
};

// Runs of one colour in a row become one rectangle, and equal neighbouring rows one taller one.
std::string svg_rectangles(const Panel& panel) {
  const StructureImage& image = panel.image;
  std::string out;
  for (int y = 0; y < image.height;) {
    const auto row = image.pixels.begin() + static_cast<std::ptrdiff_t>(y) * image.width;
    int rows = 1;
    while (y + rows < image.height &&
           std::equal(row, row + image.width, row + static_cast<std::ptrdiff_t>(rows) * image.width))
      ++rows;
    for (int x = 0; x < image.width;) {
      int end = x + 1;
      while (end < image.width && row[end] == row[x]) ++end;
      if (row[x] != 0) {
        out += fmt::format("<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"{}\"/>\n",
                           panel.left + panel.zoom_x * x, panel.top + panel.zoom_y * y,
                           panel.zoom_x * (end - x), panel.zoom_y * rows, kColours[row[x]]);
      }
      x = end;
    }
    y += rows;
  }
  return out;
}

std::string svg_panel(const Panel& panel, const std::string& title) {
  return fmt::format(
             "<text x=\"{0}\" y=\"{1}\">{2}</text>\n<rect x=\"{0}\" y=\"{3}\" width=\"{4}\" height=\"{5}\" "
             "fill=\"#fff\" stroke=\"#444\" stroke-width=\"1\"/>\n",
             panel.left, panel.top - 8, title, panel.top, panel.width(), panel.height()) +
         svg_rectangles(panel);
}

}  // namespace

std::string format_structure_svg(const BundleStructure& s, int most_px) {
  const StructureImage J = draw_jacobian(s, most_px), N = draw_normal_matrix(s, most_px);
  constexpr double kMargin = 20, kTop = 40;
  // A small problem is drawn larger, in whole units for a scalar.
  const auto zoom = [most_px](int n) { return static_cast<double>(std::max(1, most_px / n)); };
  const Panel left{J, kMargin, kTop, zoom(J.width), zoom(J.height)};
  const Panel right{N, kMargin + left.width() + 2 * kMargin, kTop, zoom(N.width), zoom(N.height)};
  // Narrow pictures still leave room for the words above and below them.
  const double width = std::max(right.left + right.width() + kMargin, 640.0);
  const double drawn = std::max(left.height(), right.height());
  std::array<int, 3> n{};
  for (const auto& column : s.columns) ++n[static_cast<std::size_t>(column.kind)];
  std::string out = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0}\" height=\"{1}\" viewBox=\"0 0 {0} {1}\" "
      "font-family=\"sans-serif\" font-size=\"13\" shape-rendering=\"crispEdges\">\n"
      "<rect width=\"{0}\" height=\"{1}\" fill=\"#fff\"/>\n",
      width, kTop + drawn + 2 * kMargin + 10);
  const long rows = offsets_of(s.row_size).back(), columns = column_offsets(s).back();
  out += svg_panel(left, fmt::format("J, {} x {}", rows, columns));
  out += svg_panel(right, fmt::format("J'J, {0} x {0}", columns));
  const auto counted = [](int count, const char* one, const char* many) {
    return fmt::format("{} {}", count, count == 1 ? one : many);
  };
  const std::array<std::string, 4> legend{counted(n[0], "lens", "lenses"), counted(n[1], "view", "views"),
                                          counted(n[2], "point", "points"), "blocks of two kinds"};
  for (std::size_t i = 0; i < legend.size(); ++i) {
    const double x = kMargin + 150 * static_cast<double>(i), y = kTop + drawn + kMargin;
    out += fmt::format(
        "<rect x=\"{}\" y=\"{}\" width=\"12\" height=\"12\" fill=\"{}\"/><text x=\"{}\" y=\"{}\">{}</text>\n",
        x, y, kColours[i + 1], x + 17, y + 11, legend[i]);
  }
  return out + "</svg>\n";
}

}  // namespace plumbline
