// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>

#include "detect/disc_fit.hpp"
#include "detect/look_view.hpp"
#include "detect/median.hpp"
#include "detect/subpixel.hpp"
#include "plumbline/detect/circle_bias.hpp"
#include "plumbline/rig/validity.hpp"

namespace plumbline::detail {
namespace {

constexpr int kMinDiscs = 6;
constexpr double kMinShare = 1.0 / 3;
constexpr double kOffSize = 0.2;                  ///< of the usual diameter
constexpr double kOffPx = 1, kOffDeviations = 6;  ///< from where the others are, about their own places

/// One disc foretold and found.
struct Pair {
  MeasuredDisc disc;
  Vec2 off;  ///< found less foretold
};

double diameter_of(double area_px2, const Mat2& J) {
  return 2 * std::sqrt(area_px2 / (std::numbers::pi * std::abs(J.determinant())));
}

}  // namespace

double disc_diameter(const cv::Mat& grey, const ViewBefore& b) {
  std::vector<double> diameters;
  for (const Corner& c : b.corners) {
    const PointFeature& f = (*b.features)[c.point];
    const auto place = place_of(b.camera->lens, b.T_cam_target, (*b.p_target)[c.point], f);
    if (!place) continue;
    const double nearest = 2 * f.radius + f.gap;
    const DarkBlob blob = dark_blob(grey, c.px, 0.5 * nearest * least_stretch(place->J));
    if (blob.area_px2 > 0) diameters.push_back(diameter_of(blob.area_px2, place->J));
  }
  return median(diameters);
}

std::vector<MeasuredDisc> look_for_discs(const cv::Mat& grey, const ViewBefore& b) {
  std::vector<Pair> pairs;
  std::vector<Vec2> all_px;
  int n_seen = 0;
  double noise = 0;
  for (std::size_t i = 0; i < b.p_target->size(); ++i) {
    const PointFeature& f = (*b.features)[i];
    const Vec3& p = (*b.p_target)[i];
    if (f.radius <= 0 || !project(*b.camera, b.T_cam_target * p)) continue;
    const auto place = place_of(b.camera->lens, b.T_cam_target, p, f);
    const double unit_m = f.u.norm();
    const auto image = disc_image(b.camera->lens, b.T_cam_target, p, 2 * f.radius * unit_m);
    if (!place || !image) continue;
    const Vec2 at = image->centroid_px;
    if (at.x() < 0 || at.y() < 0 || at.x() > grey.cols - 1 || at.y() > grey.rows - 1) continue;
    ++n_seen;
    if (noise == 0) noise = noise_level(grey, {0, 0, grey.cols, grey.rows});
    const double stretch = least_stretch(place->J);
    const auto fit = fit_disc(
        grey, {at, place->J, f.radius, f.gap / 2 * stretch, 0.3 * (2 * f.radius + f.gap) * stretch}, noise);
    if (!fit) continue;
    // The image's area, not that of its local map: a lens may bend the outline.
    const double diameter = 2 * f.radius * std::sqrt(fit->area_px2 / image->area_px2);
    pairs.push_back({{static_cast<int>(i), fit->centroid, fit->sigma_px, diameter}, fit->centroid - at});
  }
  std::vector<double> size, dx, dy, spread;
  for (const Pair& p : pairs)
    size.push_back(p.disc.diameter), dx.push_back(p.off.x()), dy.push_back(p.off.y());
  const double usual = median(size);
  const Vec2 off(median(dx), median(dy));
  for (const Pair& p : pairs) spread.push_back((p.off - off).norm());
  const double limit = std::max(kOffPx, kOffDeviations * median(spread));
  std::vector<MeasuredDisc> out;
  for (const Pair& p : pairs) {
    if (std::abs(p.disc.diameter / usual - 1) < kOffSize && (p.off - off).norm() < limit)
      out.push_back(p.disc);
  }
  if (static_cast<int>(out.size()) < kMinDiscs || static_cast<double>(out.size()) < kMinShare * n_seen)
    return {};
  return out;
}

}  // namespace plumbline::detail
