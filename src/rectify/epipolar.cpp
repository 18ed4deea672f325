// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cmath>
#include <map>

#include "plumbline/rectify/rectify.hpp"

namespace plumbline {
namespace {

// The inlier corners of a camera by (frame, target, point).
using Corners = std::map<std::array<int, 3>, Vec2>;

Corners inliers_of(const Calibration& calibration, int cam) {
  Corners out;
  for (std::size_t v = 0; v < calibration.data.views.size() && v < calibration.fits.size(); ++v) {
    const View& view = calibration.data.views[v];
    if (view.cam != cam || calibration.fits[v].size() != view.corners.size()) continue;
    for (std::size_t c = 0; c < view.corners.size(); ++c) {
      if (!calibration.fits[v][c].outlier)
        out[{view.frame, view.target, view.corners[c].point}] = view.corners[c].px;
    }
  }
  return out;
}

}  // namespace

std::optional<Vec2> rectify_pixel(const StereoRectification& rectification, const Lens& lens, int which,
                                  const Vec2& px) {
  PLUMBLINE_CHECK(which == 0 || which == 1, "a rectified pair has cameras 0 and 1");
  const auto ray = unproject(lens, px);
  if (!ray) return std::nullopt;
  const Vec3 p_rect = rectification.R_rect_cam[which] * *ray;
  if (!(p_rect.z() > 0)) return std::nullopt;
  return Vec2((rectification.P[which].leftCols<3>() * p_rect).hnormalized());
}

std::optional<double> vertical_rms_px(const StereoRectification& rectification,
                                      const Calibration& calibration) {
  Corners corners[2];
  const Lens* lens[2] = {};
  for (int i = 0; i < 2; ++i) {
    const auto cam = calibration.rig.find(rectification.cameras[i]);
    if (!cam) return std::nullopt;
    corners[i] = inliers_of(calibration, *cam);
    lens[i] = &calibration.rig.cameras[*cam].lens;
  }
  const int across = rectification.vertical ? 0 : 1;
  double sum = 0;
  int n = 0;
  for (const auto& [key, px] : corners[0]) {
    const auto other = corners[1].find(key);
    if (other == corners[1].end()) continue;
    const auto a = rectify_pixel(rectification, *lens[0], 0, px);
    const auto b = rectify_pixel(rectification, *lens[1], 1, other->second);
    if (!a || !b) continue;
    sum += std::pow((*a)[across] - (*b)[across], 2);
    ++n;
  }
  if (n == 0) return std::nullopt;
  return std::sqrt(sum / n);
}

}  // namespace plumbline
