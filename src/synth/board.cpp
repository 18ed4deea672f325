// SPDX-License-Identifier: Apache-2.0
#include "plumbline/synth/board.hpp"

#include <fmt/format.h>

#include "markers.hpp"

namespace plumbline {
namespace {

// Black modules as few rectangles: each run of a row, extended downwards while the rows below have the same
// run whole. `top_left` is the marker's corner in a frame with y down; mirrored to y up by the caller.
void add_modules(const detail::Modules& modules, const Vec2& top_left, double side_m,
                 std::vector<Box>& boxes) {
  const int n = modules.n;
  const double module_m = side_m / n;
  std::vector<char> done(static_cast<std::size_t>(n * n), 0);
  const auto open = [&](int r, int c) {
    return modules.at(r, c) && !done[static_cast<std::size_t>(r * n + c)];
  };
  for (int r = 0; r < n; ++r) {
    for (int c = 0; c < n; ++c) {
      if (!open(r, c)) continue;
      int c_end = c, r_end = r;
      while (c_end < n && open(r, c_end)) ++c_end;
      for (bool whole = true; r_end < n && whole;) {
        for (int k = c; k < c_end; ++k) whole = whole && open(r_end, k);
        if (whole) ++r_end;
      }
      for (int y = r; y < r_end; ++y) {
        for (int x = c; x < c_end; ++x) done[static_cast<std::size_t>(y * n + x)] = 1;
      }
      boxes.push_back({top_left + module_m * Vec2(c, r), top_left + module_m * Vec2(c_end, r_end)});
    }
  }
}

std::string mm(double length_m) { return fmt::format("{:.6g} mm", 1e3 * length_m); }

// Squares (column, row) with column + row of the given parity are black; the first inner corner is the
// origin.
void add_squares(int columns, int rows, double square_m, int parity, std::vector<Box>& boxes) {
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      if ((r + c) % 2 != parity) continue;
      boxes.push_back({square_m * Vec2(c - 1, r - 1), square_m * Vec2(c, r)});
    }
  }
}

Result<BoardDrawing> draw(const Chessboard& b) {
  BoardDrawing drawing;
  add_squares(b.columns + 1, b.rows + 1, b.square_m, 0, drawing.boxes);
  drawing.low = Vec2::Constant(-b.square_m);
  drawing.high = b.square_m * Vec2(b.columns, b.rows);
  drawing.margin_m = b.square_m;
  drawing.note = fmt::format("{}x{} inner corners, square {}", b.columns, b.rows, mm(b.square_m));
  return drawing;
}

Result<BoardDrawing> draw(const Charuco& b) {
  BoardDrawing drawing;
  const bool marker_first = b.layout == Charuco::Layout::kLegacy && b.rows % 2 == 0;
  const int black_parity = marker_first ? 1 : 0;
  add_squares(b.columns, b.rows, b.square_m, black_parity, drawing.boxes);
  int id = b.first_id;
  for (int r = 0; r < b.rows; ++r) {
    for (int c = 0; c < b.columns; ++c) {
      if ((r + c) % 2 == black_parity) continue;
      const auto modules = detail::aruco_modules(b.dictionary, id++);
      if (!modules) return modules.error();
      const Vec2 square = b.square_m * Vec2(c - 1, r - 1);
      add_modules(*modules, square + Vec2::Constant(0.5 * (b.square_m - b.marker_m)), b.marker_m,
                  drawing.boxes);
    }
  }
  drawing.low = Vec2::Constant(-b.square_m);
  drawing.high = b.square_m * Vec2(b.columns - 1, b.rows - 1);
  drawing.margin_m = 0.5 * b.square_m;
  drawing.note =
      fmt::format("{}x{} squares of {}, marker {}, {} ids {}..{}{}", b.columns, b.rows, mm(b.square_m),
                  mm(b.marker_m), b.dictionary, b.first_id, id - 1, marker_first ? ", legacy layout" : "");
  return drawing;
}

Result<BoardDrawing> draw(const AprilGrid& b) {
  BoardDrawing drawing;
  drawing.y_up = true;
  const double gap = b.spacing * b.tag_m, pitch = b.tag_m + gap;
  for (int r = 0; r < b.rows; ++r) {
    for (int c = 0; c < b.columns; ++c) {
      const auto modules = detail::april_modules(b.family, b.first_id + r * b.columns + c, b.border);
      if (!modules) return modules.error();
      std::vector<Box> tag;  // in a frame at the tag's top left with y down
      add_modules(*modules, Vec2::Zero(), b.tag_m, tag);
      const Vec2 top_left(c * pitch, r * pitch + b.tag_m);
      for (const Box& box : tag) {
        drawing.boxes.push_back(
            {top_left + Vec2(box.low.x(), -box.high.y()), top_left + Vec2(box.high.x(), -box.low.y())});
      }
    }
  }
  for (int r = 0; r <= b.rows; ++r) {
    for (int c = 0; c <= b.columns; ++c) {
      drawing.boxes.push_back({Vec2(c * pitch - gap, r * pitch - gap), Vec2(c * pitch, r * pitch)});
    }
  }
  drawing.low = Vec2::Constant(-gap);
  drawing.high = pitch * Vec2(b.columns, b.rows);
  drawing.margin_m = 0.5 * gap;
  drawing.note = fmt::format("{}x{} tags of {}, gap {}, tag{} ids {}..{}", b.columns, b.rows, mm(b.tag_m),
                             mm(gap), b.family, b.first_id, b.first_id + b.columns * b.rows - 1);
  if (b.border != 2) drawing.note += fmt::format(", border of {} module", b.border);
  return drawing;
}

Result<BoardDrawing> draw(const Circles& b) {
  BoardDrawing drawing;
  const double diameter = b.diameter_m > 0 ? b.diameter_m : (b.asymmetric ? 0.8 : 0.5) * b.spacing_m;
  double right = 0;
  for (int r = 0; r < b.rows; ++r) {
    for (int c = 0; c < b.columns; ++c) {
      const double x = (b.asymmetric ? 2 * c + r % 2 : c) * b.spacing_m;
      right = std::max(right, x);
      drawing.discs.push_back({Vec2(x, r * b.spacing_m), 0.5 * diameter});
    }
  }
  drawing.low = Vec2::Constant(-0.5 * diameter);
  drawing.high = Vec2(right, (b.rows - 1) * b.spacing_m) + Vec2::Constant(0.5 * diameter);
  drawing.margin_m = b.spacing_m;
  drawing.note = fmt::format("{}x{} {}circles, spacing {}, diameter {}", b.columns, b.rows,
                             b.asymmetric ? "asymmetric " : "", mm(b.spacing_m), mm(diameter));
  return drawing;
}

Result<BoardDrawing> draw(const Points3d&) {
  return Error{ErrorCode::kUnsupported, "free 3-D points have no drawing; observe them with other software",
               "target"};
}

Result<BoardDrawing> draw(const BoardRig&) {
  return Error{ErrorCode::kUnsupported, "a rig inside a rig has no drawing", "target"};
}

}  // namespace

Result<std::vector<BoardDrawing>> draw_target(const Target& target) {
  std::vector<BoardDrawing> drawings;
  const auto add = [&](const TargetSpec& spec, const SE3& T_target_board) -> Status {
    auto drawing = std::visit([](const auto& board) { return draw(board); }, spec);
    if (!drawing) return drawing.error();
    drawing->name = target.name;
    drawing->T_target_board = T_target_board;
    drawings.push_back(*std::move(drawing));
    return {};
  };
  if (const auto* rig = std::get_if<BoardRig>(&target.spec)) {
    for (const BoardPart& part : rig->parts) {
      if (Status added = add(part.board, part.T_target_board); !added) return added.error();
      drawings.back().name = fmt::format("{} part {} of {}", target.name, drawings.size(), rig->parts.size());
    }
  } else if (Status added = add(target.spec, SE3()); !added) {
    return added.error();
  }
  return drawings;
}

bool is_black(const BoardDrawing& drawing, const Vec2& p) {
  for (const Box& box : drawing.boxes) {
    if ((p.array() >= box.low.array()).all() && (p.array() <= box.high.array()).all()) return true;
  }
  for (const Disc& disc : drawing.discs) {
    if ((p - disc.centre).norm() <= disc.radius) return true;
  }
  return false;
}

}  // namespace plumbline
