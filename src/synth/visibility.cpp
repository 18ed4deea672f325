// SPDX-License-Identifier: Apache-2.0
#include "visibility.hpp"

#include <cmath>
#include <numbers>

#include "plumbline/core/check.hpp"
#include "plumbline/synth/scene.hpp"

namespace plumbline {
namespace {

constexpr double kImageBorderPx = 2;  // corners nearer to the image's edge are not counted on

// A board's plane and sheet, seen from the camera's centre.
struct Sheet {
  SE3 T_board_target;
  Vec3 eye_board;
  Vec2 low, high;
  bool front;

  Sheet(const BoardDrawing& d, const Vec3& eye_target)
      : T_board_target(d.T_target_board.inverse()),
        eye_board(T_board_target * eye_target),
        low(d.sheet_low()),
        high(d.sheet_high()) {
    front = d.y_up ? eye_board.z() > 0 : eye_board.z() < 0;
  }

  // Whether the sheet cuts the line of sight to the point, clearly before the point itself.
  bool hides(const Vec3& p_target) const {
    const Vec3 p = T_board_target * p_target, d = p - eye_board;
    if (d.z() == 0) return false;
    const double share = -eye_board.z() / d.z();
    if (!(share > 0 && share < 1 - 1e-6)) return false;
    const Vec2 cut = (eye_board + share * d).head<2>();
    return (cut.array() >= low.array()).all() && (cut.array() <= high.array()).all();
  }
};

// The pixel of a point when it is in the image.
std::optional<Vec2> inside(const Camera& camera, const Vec3& p_cam) {
  const auto px = project(camera.lens, p_cam);
  const Vec2 low = Vec2::Constant(kImageBorderPx - 0.5),
             high = Vec2(camera.size.width, camera.size.height) - low - Vec2::Ones();
  if (!px || (px->array() < low.array()).any() || (px->array() > high.array()).any()) return std::nullopt;
  return px;
}

// A circle is seen by its rim: all of it must be in the image. Circle grids are never parts of rigs.
bool disc_inside(const Disc& disc, const Camera& camera, const SE3& T_cam_target) {
  for (int i = 0; i < 8; ++i) {
    const double angle = i * std::numbers::pi / 4;
    const Vec2 rim = disc.centre + disc.radius * Vec2(std::cos(angle), std::sin(angle));
    if (!inside(camera, T_cam_target * Vec3(rim.x(), rim.y(), 0))) return false;
  }
  return true;
}

}  // namespace

namespace detail {

std::vector<int> points_per_drawing(const Target& target) {
  std::vector<int> counts;
  if (const auto* rig = std::get_if<BoardRig>(&target.spec)) {
    for (const BoardPart& part : rig->parts)
      counts.push_back(static_cast<int>(make_target(part.board)->points.size()));
  } else {
    counts.push_back(static_cast<int>(target.points.size()));
  }
  return counts;
}

bool needs_whole(const TargetSpec& spec) {
  return std::holds_alternative<Chessboard>(spec) || std::holds_alternative<Circles>(spec);
}

}  // namespace detail

std::vector<Corner> visible_corners(const Target& target, const std::vector<BoardDrawing>& drawings,
                                    const Camera& camera, const SE3& T_cam_target) {
  const Vec3 eye_target = T_cam_target.centre();
  std::vector<Sheet> sheets;
  for (const BoardDrawing& drawing : drawings) sheets.emplace_back(drawing, eye_target);
  const std::vector<int> counts = drawings.empty() ? std::vector<int>{} : detail::points_per_drawing(target);
  PLUMBLINE_CHECK(counts.size() == sheets.size(),
                  "visible_corners: the drawings are not those of the target");

  std::vector<Corner> corners;
  int board = 0, left = counts.empty() ? 0 : counts[0];
  for (int i = 0; i < static_cast<int>(target.points.size()); ++i) {
    if (!counts.empty()) {
      while (left == 0) left = counts[static_cast<std::size_t>(++board)];
      --left;
      if (!sheets[static_cast<std::size_t>(board)].front) continue;
    }
    const auto px = inside(camera, T_cam_target * target.points[i]);
    if (!px) continue;
    if (!sheets.empty() && !drawings[static_cast<std::size_t>(board)].discs.empty() &&
        !disc_inside(drawings[static_cast<std::size_t>(board)].discs[static_cast<std::size_t>(i)], camera,
                     T_cam_target)) {
      continue;
    }
    bool hidden = false;
    for (std::size_t k = 0; k < sheets.size() && !hidden; ++k) {
      hidden = static_cast<int>(k) != board && sheets[k].hides(target.points[i]);
    }
    if (!hidden) corners.push_back({i, *px, 1.0});
  }
  return corners;
}

}  // namespace plumbline
