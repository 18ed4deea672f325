// SPDX-License-Identifier: Apache-2.0
#include "io/formats/mrcal_region.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "plumbline/rig/validity.hpp"

namespace plumbline::io {
namespace {

Vec2 centre_of(const Camera& camera) { return {params(camera.lens)[2], params(camera.lens)[3]}; }

// How far it is from the centre along a direction to the border of the picture.
double border_px(const Camera& camera, const Vec2& out) {
  double far = std::numeric_limits<double>::infinity();
  const Vec2 centre = centre_of(camera), last(camera.size.width - 1, camera.size.height - 1);
  for (int axis : {0, 1}) {
    if (out[axis] > 0) far = std::min(far, (last[axis] - centre[axis]) / out[axis]);
    if (out[axis] < 0) far = std::min(far, centre[axis] / -out[axis]);
  }
  return far;
}

bool holds_centre(const Camera& camera) {
  const Vec2 c = centre_of(camera);
  return c.x() > 0 && c.y() > 0 && c.x() < camera.size.width - 1 && c.y() < camera.size.height - 1;
}

}  // namespace

std::optional<std::string> region_text(const Camera& camera) {
  Camera limited = camera;
  if (!limited.validity && folds_in_image(camera)) limited.validity = fold_of(camera.lens).end;
  if (!limited.validity || !holds_centre(camera)) return std::nullopt;
  const Vec2 centre = centre_of(camera);
  constexpr int kDirections = 180;
  std::vector<double> around;
  for (int i = 0; i < kDirections; ++i) around.push_back(2 * std::numbers::pi * i / kDirections);
  for (int corner = 0; corner < 4; ++corner) {
    const Vec2 d =
        Vec2((corner & 1) * (camera.size.width - 1), (corner >> 1) * (camera.size.height - 1)) - centre;
    const double angle = std::atan2(d.y(), d.x());
    around.push_back(angle < 0 ? angle + 2 * std::numbers::pi : angle);
  }
  std::sort(around.begin(), around.end());
  std::vector<Vec2> contour;
  for (double angle : around) {
    const Vec2 out(std::cos(angle), std::sin(angle));
    double low = 0, high = border_px(camera, out);
    if (unproject(limited, centre + high * out)) low = high;
    while (high - low > 1e-10 * high) {
      const double middle = 0.5 * (low + high);
      (unproject(limited, centre + middle * out) ? low : high) = middle;
    }
    contour.push_back(centre + low * out);
  }
  contour.push_back(contour.front());
  std::string text = "[";
  for (const Vec2& px : contour) text += (text.size() > 1 ? ", " : "") + yaml_numbers(px);
  return text + "]";
}

std::optional<Validity> read_region(const Field& field, const Camera& camera) {
  const std::vector<double> values = field.numbers();
  if (values.size() < 6 || values.size() % 2 != 0) {
    field.fail(fmt::format("{} numbers are not a contour of [x, y] points, of which there are three or more",
                           values.size()),
               ErrorCode::kUnsupported);
  }
  std::vector<Vec2> contour;
  for (std::size_t i = 0; i < values.size(); i += 2) contour.emplace_back(values[i], values[i + 1]);
  const double w = camera.size.width - 1, h = camera.size.height - 1;
  const auto inside = [&](const Vec2& px) {
    return px.x() > 0.5 && px.y() > 0.5 && px.x() < w - 0.5 && px.y() < h - 0.5;
  };
  double angle = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < contour.size(); ++i) {
    // Points of long edges too: between two corners of a coarse contour it comes nearer to the centre.
    const Vec2 from = contour[i], to = contour[(i + 1) % contour.size()];
    const int n = static_cast<int>(std::min(100.0, 1 + (to - from).norm() / (0.05 * std::hypot(w, h))));
    for (int k = 0; k < n; ++k) {
      const Vec2 px = from + (to - from) * (static_cast<double>(k) / n);
      const auto ray = inside(px) ? unproject(camera.lens, px) : std::nullopt;
      if (ray) angle = std::min(angle, std::atan2(ray->head<2>().norm(), ray->z()));
    }
  }
  if (!std::isfinite(angle)) return std::nullopt;
  if (!(angle > 0)) field.fail("the contour passes through the centre of the image", ErrorCode::kUnsupported);
  return validity_of(camera.lens, angle);
}

}  // namespace plumbline::io
