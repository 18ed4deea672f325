// SPDX-License-Identifier: Apache-2.0
#include "detect/look_view.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "detect/median.hpp"
#include "detect/planar.hpp"
#include "detect/subpixel.hpp"
#include "plumbline/linear/pose.hpp"
#include "plumbline/rig/validity.hpp"

namespace plumbline::detail {
namespace {

constexpr double kBorder = 2;         ///< px; corners nearer to the image's border are not looked for
constexpr double kFaint = 0.35;       ///< of the usual contrast
constexpr double kLooseMisfit = 2;    ///< times the usual one, of a corner that is kept
constexpr double kLeastMisfit = 0.1;  ///< of the contrast; less is never held against a corner
constexpr double kOffPx = 0.5, kOffSigmas = 5;  ///< from where it was foretold
constexpr double kOffPose = 4;                  ///< times the usual residual
constexpr double kOffPosePx = 0.3;              ///< and no less than that
constexpr double kMinClean = 1.5;               ///< px beside an edge
constexpr int kMinCorners = 6, kNeighbours = 4;
constexpr double kMinShare = 1.0 / 3;
constexpr double kMostShift = 0.25;  ///< of a square: a pose that is off by more may be one square off

bool is_inside(const Vec2& px, const cv::Mat& grey) {
  return px.x() >= kBorder && px.y() >= kBorder && px.x() <= grey.cols - 1 - kBorder &&
         px.y() <= grey.rows - 1 - kBorder;
}

using Places = std::map<int, PointPlace>;

Places places_in_image(const ViewBefore& b, const SE3& T_cam_target, const cv::Mat& grey) {
  Places out;
  for (std::size_t i = 0; i < b.p_target->size(); ++i) {
    const Vec3& p = (*b.p_target)[i];
    if (!project(*b.camera, T_cam_target * p)) continue;  // beyond what the calibration vouches for
    const auto place = place_of(b.camera->lens, T_cam_target, p, (*b.features)[i]);
    if (place && is_inside(place->px, grey)) out[static_cast<int>(i)] = *place;
  }
  return out;
}

struct Known {
  Corner corner;
  double strength = 0;  ///< contrast times the sign of the board's pattern
  double misfit = 0;    ///< of the contrast
};
using KnownCorners = std::map<int, Known>;

std::optional<Known> fit_at(const cv::Mat& grey, int point, const PointFeature& feature,
                            const PointPlace& place, const Vec2& start, double max_move_px, double noise) {
  SaddleWindow window = feature.window;
  window.J = place.J;
  window.curvature = place.curvature;
  window.max_move_px = max_move_px;
  auto fit = fit_saddle(grey, start, window, noise);
  if (!fit) {
    window.max_arm_px = kShortArmPx;
    fit = fit_saddle(grey, start, window, noise);
  }
  if (!fit) return std::nullopt;
  return Known{
      {point, fit->px, fit->sigma_px}, fit->contrast * feature.sign, fit->misfit / std::abs(fit->contrast)};
}

/// What corners of this board look like in this image.
struct Usual {
  double strength = 0;  ///< signed
  double misfit = 0;
};

Usual usual_of(const KnownCorners& known) {
  std::vector<double> strength, misfit;
  for (const auto& [point, k] : known) {
    if (k.strength == 0) continue;
    strength.push_back(k.strength);
    misfit.push_back(k.misfit);
  }
  return {median(strength), std::max(kLeastMisfit, median(misfit))};
}

bool looks_like(const Known& k, const Usual& usual) {
  return k.strength / usual.strength >= kFaint && k.misfit <= kLooseMisfit * usual.misfit;
}

/// What the lens is off at the corners nearest to a place.
Vec2 offset_near(const Places& places, const KnownCorners& known, const Vec2& px) {
  std::vector<std::pair<double, Vec2>> near;
  for (const auto& [point, k] : known) {
    const auto place = places.find(point);
    if (place != places.end())
      near.push_back({(place->second.px - px).norm(), k.corner.px - place->second.px});
  }
  const std::size_t n = std::min<std::size_t>(kNeighbours, near.size());
  std::partial_sort(near.begin(), near.begin() + static_cast<long>(n), near.end(),
                    [](const auto& a, const auto& b) { return a.first < b.first; });
  Vec2 sum = Vec2::Zero();
  for (std::size_t i = 0; i < n; ++i) sum += near[i].second / static_cast<double>(n);
  return sum;
}

/// The pose through corners; nullopt when they determine none.
std::optional<SE3> pose_of(const ViewBefore& b, const KnownCorners& known) {
  std::vector<Vec3> p;
  std::vector<Vec2> px;
  for (const auto& [point, k] : known) p.push_back((*b.p_target)[point]), px.push_back(k.corner.px);
  const auto pose = pose_from_points(b.camera->lens, p, px);
  return pose ? std::optional(*pose) : std::nullopt;
}

double residual(const ViewBefore& b, const SE3& T, const Corner& c) {
  const auto px = project(b.camera->lens, T * (*b.p_target)[c.point]);
  return px ? (*px - c.px).norm() : 1e9;
}

/// A board of which nothing is known but where it should be: corners that agree on a pose near the one
/// foretold. Empty when too few do.
KnownCorners begin(const cv::Mat& grey, const ViewBefore& b, double noise, SE3& T) {
  const Places places = places_in_image(b, T, grey);
  KnownCorners found;
  for (const auto& [point, place] : places) {
    const double height = narrow_height(place.J);
    const PointFeature& feature = (*b.features)[point];
    if (std::min(1.0, feature.window.across) * height < kMinClean) continue;
    // Not as far as the next corner, which of an AprilGrid is across the gap.
    const double next = std::min(-feature.window.low.maxCoeff(), feature.window.high.minCoeff());
    const double reach = std::max(1.5, std::min(1.4 * kMostShift, 0.45 * next) * height);
    const auto fit = fit_at(grey, point, feature, place, place.px, reach, noise);
    if (fit && (!feature.is_sign_absolute || fit->strength > 0)) found[point] = *fit;
  }
  const Usual usual = usual_of(found);
  std::erase_if(found, [&](const auto& f) { return !looks_like(f.second, usual); });
  const auto needed = std::max<std::size_t>(
      kMinCorners, static_cast<std::size_t>(std::ceil(kMinShare * static_cast<double>(places.size()))));
  if (found.size() < needed) return {};
  std::vector<Vec3> p;
  std::vector<Vec2> px;
  for (const auto& [point, k] : found) p.push_back((*b.p_target)[point]), px.push_back(k.corner.px);
  RansacOptions options;
  options.inlier_px = std::max(0.7, kOffPose * b.usual_rms_px);
  const auto pose = pose_ransac(b.camera->lens, p, px, options);
  if (!pose || static_cast<std::size_t>(pose->consensus.n_inliers) < needed) return {};
  std::vector<double> shift;
  KnownCorners kept;
  std::size_t i = 0;
  for (const auto& [point, k] : found) {
    if (!pose->consensus.inlier[i++]) continue;
    kept[point] = k;
    const PointPlace& place = places.at(point);
    shift.push_back((place.px - k.corner.px).norm() / narrow_height(place.J));
  }
  if (median(shift) > kMostShift) return {};
  T = pose->model;
  return kept;
}

/// The corners found at the first look with what they look like; those that do not fit again keep their
/// place.
KnownCorners measured_again(const cv::Mat& grey, const ViewBefore& b, const Places& places, double noise) {
  KnownCorners out;
  for (const Corner& c : b.corners) {
    Known known{c, 0, 0};
    const auto place = places.find(c.point);
    if (place != places.end()) {
      if (const auto fit = fit_at(grey, c.point, (*b.features)[c.point], place->second, c.px, 1.0, noise))
        known.strength = fit->strength, known.misfit = fit->misfit;
    }
    out[c.point] = known;
  }
  return out;
}

/// Grows the known corners over the board, nearest first.
void grow(const cv::Mat& grey, const ViewBefore& b, const Places& places, double noise, KnownCorners& known) {
  const Usual usual = usual_of(known);
  if (usual.strength == 0) return;
  for (int round = 0; round < 3; ++round) {
    bool is_new = false;
    for (const auto& [point, place] : places) {
      const PointFeature& feature = (*b.features)[point];
      const double height = narrow_height(place.J);
      if (known.contains(point) || std::min(1.0, feature.window.across) * height < kMinClean) continue;
      const Vec2 start = place.px + offset_near(places, known, place.px);
      if (!is_inside(start, grey)) continue;
      const auto fit = fit_at(grey, point, feature, place, start, std::min(3.0, 0.2 * height), noise);
      if (!fit || !looks_like(*fit, usual)) continue;
      if ((fit->corner.px - start).norm() > kOffPx + kOffSigmas * fit->corner.sigma_px) continue;
      known[point] = *fit;
      is_new = true;
    }
    if (!is_new) return;
  }
}

}  // namespace

std::optional<ViewAfter> look_for_saddles(const cv::Mat& grey, const ViewBefore& b) {
  SE3 T = b.T_cam_target;
  std::vector<Vec2> all_px;
  for (const auto& [point, place] : places_in_image(b, T, grey)) all_px.push_back(place.px);
  if (all_px.size() <= b.corners.size() || all_px.size() < 4) return std::nullopt;
  const double noise = noise_level(grey, bounding_box(all_px, grey));
  KnownCorners known;
  if (b.corners.empty()) {
    known = begin(grey, b, noise, T);
    if (known.empty()) return std::nullopt;
  }
  const Places places = places_in_image(b, T, grey);
  if (known.empty()) known = measured_again(grey, b, places, noise);
  const KnownCorners trusted = known;
  grow(grey, b, places, noise, known);
  const auto pose = pose_of(b, known);
  if (!pose) return std::nullopt;
  std::vector<double> usual;
  for (const auto& [point, k] : trusted) usual.push_back(residual(b, *pose, k.corner));
  const double limit = std::max({kOffPosePx, kOffPose * median(usual), kOffPose * b.usual_rms_px});
  ViewAfter out;
  out.T_cam_target = *pose;
  for (const auto& [point, k] : known) {
    const bool is_old = !b.corners.empty() && trusted.contains(point);
    if (!is_old && residual(b, *pose, k.corner) > limit + kOffSigmas * k.corner.sigma_px) continue;
    out.corners.push_back(k.corner);
    out.n_new += is_old ? 0 : 1;
  }
  if (out.n_new == 0 || static_cast<int>(out.corners.size()) < kMinCorners) return std::nullopt;
  return out;
}

}  // namespace plumbline::detail
