// SPDX-License-Identifier: Apache-2.0
#include "plumbline/synth/corner.hpp"

#include "plumbline/synth/board.hpp"

namespace plumbline {

Result<BoardRig> corner_rig(const TargetSpec& panel, CornerKind kind) {
  const bool fits = std::holds_alternative<Charuco>(panel) || std::holds_alternative<AprilGrid>(panel);
  if (!fits)
    return Error{ErrorCode::kUnsupported,
                 "a corner is made of charuco or aprilgrid boards, whose ids tell them apart", "corner"};
  const auto target = make_target(panel);
  if (!target) return target.error();
  const auto drawings = draw_target(*target);
  if (!drawings) return drawings.error();
  const BoardDrawing& d = drawings->front();
  const Vec2 size = d.sheet_high() - d.sheet_low();
  const Vec2 start = kind == CornerKind::kInside ? Vec2(0, 0) : Vec2(-size);

  BoardRig rig;
  for (int i = 0; i < 3; ++i) {
    // The face's normal n and its axes a, b, with a x b = n: (x, y, z), then turned through the three axes.
    const Vec3 a = Vec3::Unit(i), b = Vec3::Unit((i + 1) % 3), n = Vec3::Unit((i + 2) % 3);
    Mat3 R;
    Vec3 t;
    if (d.y_up) {
      R << a, b, n;
      t = (start.x() - d.sheet_low().x()) * a + (start.y() - d.sheet_low().y()) * b;
    } else {
      R << a, -b, -n;
      t = (start.x() - d.sheet_low().x()) * a + (start.y() + d.sheet_high().y()) * b;
    }
    BoardPart part{panel, SE3(R, t)};
    if (auto* c = std::get_if<Charuco>(&part.board)) c->first_id += i * (c->columns * c->rows / 2);
    if (auto* g = std::get_if<AprilGrid>(&part.board)) g->first_id += i * g->columns * g->rows;
    rig.parts.push_back(part);
  }
  if (const auto whole = make_target(rig); !whole) return whole.error();
  return rig;
}

}  // namespace plumbline
