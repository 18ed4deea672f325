// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "plumbline/rectify/rectify.hpp"
#include "rectify/valid_region.hpp"

namespace plumbline {
namespace {

struct Box {
  Vec2 low, high;
};

// A rectangle inside the outline that cannot grow: the largest of the image's proportions around the axis,
// then each side moved out to the first point of the outline that it meets. For a lens whose straight edges
// bow inwards these are the innermost points of each edge, which is OpenCV's inner rectangle.
Box inner_box(const std::vector<Vec2>& outline, const detail::Frame& frame) {
  const double focal = detail::focal_of_valid(frame, {outline});
  Box box{-frame.anchor_px / focal,
          (Vec2(frame.size.width - 1, frame.size.height - 1) - frame.anchor_px) / focal};
  for (int axis : {0, 1}) {
    const int other = 1 - axis;
    double low = -1e9, high = 1e9;
    for (const Vec2& q : outline) {
      if (q[other] <= box.low[other] || q[other] >= box.high[other]) continue;
      if (q[axis] < 0)
        low = std::max(low, q[axis]);
      else
        high = std::min(high, q[axis]);
    }
    box.low[axis] = low;
    box.high[axis] = high;
  }
  return box;
}

Box outer_box(const std::vector<Vec2>& points) {
  Box box{points.front(), points.front()};
  for (const Vec2& q : points) {
    box.low = box.low.cwiseMin(q);
    box.high = box.high.cwiseMax(q);
  }
  return box;
}

// [fx fy cx cy] of the camera whose image the box fills, pixel centres at its edges.
Vec4 camera_showing(const Box& box, ImageSize size) {
  const Vec2 f = Vec2(size.width - 1, size.height - 1).cwiseQuotient(box.high - box.low);
  return {f.x(), f.y(), -f.x() * box.low.x(), -f.y() * box.low.y()};
}

}  // namespace

Result<Pinhole> undistorted_camera(const Camera& camera, double alpha, ImageSize size) {
  PLUMBLINE_CHECK(alpha >= 0 && alpha <= 1, "alpha is in [0, 1]");
  if (size.width <= 0 || size.height <= 0) size = camera.size;
  const detail::RotatedView view{&camera, Mat3::Identity()};
  const auto inner = detail::inner_outline(view, Vec2::Zero(), 4096);
  if (inner.empty()) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("the optical axis ({:.1f}, {:.1f}) px is not in the {}x{} image", params(camera.lens)[2],
                    params(camera.lens)[3], camera.size.width, camera.size.height),
        "camera " + camera.name};
  }
  auto outer = detail::outer_outline(view);
  outer.insert(outer.end(), inner.begin(), inner.end());
  const detail::Frame frame{Vec2::Zero(), 0.5 * Vec2(size.width - 1, size.height - 1), size};
  const Vec4 valid = camera_showing(inner_box(inner, frame), size),
             all = camera_showing(outer_box(outer), size);
  const Vec4 k = (1 - alpha) * valid + alpha * all;
  return Pinhole{k[0], k[1], k[2], k[3]};
}

}  // namespace plumbline
