// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "plumbline/linear/pose.hpp"
#include "refine/seed.hpp"

namespace plumbline::detail {

namespace {

// The points of all boards as those of one target. As every view shows the points of one board only, that is
// all that a camera alone can tell of several boards.
Target joined(const std::vector<Target>& targets, std::vector<int>& first_point) {
  if (targets.size() == 1) {
    first_point = {0};
    return targets[0];
  }
  Target all;
  for (const Target& target : targets) {
    first_point.push_back(static_cast<int>(all.points.size()));
    all.name += (all.name.empty() ? "" : " and ") + target.name;
    all.points.insert(all.points.end(), target.points.begin(), target.points.end());
    all.is_planar = all.is_planar && target.is_planar;
  }
  return all;
}

}  // namespace

MonoData mono_data(const Dataset& data, int cam) {
  MonoData mono;
  std::vector<int> first_point;
  const int n_targets = static_cast<int>(data.targets.size());
  mono.data = {{joined(data.targets, first_point)}, {data.cameras[cam]}, {}, {}, data.detector};
  for (const std::string& frame : data.frames)
    mono.data.frames.insert(mono.data.frames.end(), n_targets, frame);
  for (std::size_t v = 0; v < data.views.size(); ++v) {
    if (data.views[v].cam != cam) continue;
    View view = data.views[v];
    view.cam = 0;
    view.frame = view.frame * n_targets + view.target;
    for (Corner& c : view.corners) c.point += first_point[view.target];
    view.target = 0;
    mono.data.views.push_back(std::move(view));
    mono.view_index.push_back(static_cast<int>(v));
  }
  return mono;
}

Calibration empty_calibration(const Dataset& data, const std::vector<Lens>& lenses) {
  Calibration cal;
  cal.data = data;
  for (std::size_t i = 0; i < data.cameras.size(); ++i) {
    cal.rig.cameras.push_back({data.cameras[i].name, data.cameras[i].size, lenses[i]});
    cal.rig.T_cam_rig.emplace_back();
  }
  cal.T_rig_board.resize(data.frames.size());
  cal.T_board0_board.resize(data.targets.size());
  cal.fits.resize(data.views.size());
  cal.view_reason.resize(data.views.size());
  return cal;
}

namespace {

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double diagonal_px(ImageSize size) { return std::hypot(size.width, size.height); }

std::vector<double> errors_px(const Lens& lens, const SE3& T_cam_board, const Target& target,
                              const View& view, double lost) {
  const Mat3 R = T_cam_board.R();
  const Vec3 t = T_cam_board.t();
  std::vector<double> errors;
  errors.reserve(view.corners.size());
  for (const Corner& c : view.corners) {
    const auto px = project(lens, R * target.points[c.point] + t);
    errors.push_back(px ? std::min((*px - c.px).norm(), lost) : lost);
  }
  return errors;
}

double rms(const std::vector<double>& errors) {
  double sum = 0;
  for (double e : errors) sum += e * e;
  return errors.empty() ? 0 : std::sqrt(sum / static_cast<double>(errors.size()));
}

// At most so many, at places that follow no row and no column: multiples of the golden ratio.
std::vector<bool> spread_corners(std::size_t n, int most) {
  if (most <= 0 || static_cast<int>(n) <= most) return std::vector<bool>(n, true);
  std::vector<bool> use(n, false);
  for (int i = 0; i < most; ++i) {
    const double at = 0.6180339887498949 * (i + 1);
    use[static_cast<std::size_t>((at - std::floor(at)) * static_cast<double>(n))] = true;
  }
  return use;
}

std::optional<SE3> pose_of_corners(const Lens& lens, const Target& target, const View& view,
                                   const std::vector<bool>& use) {
  std::vector<Vec3> p_board;
  std::vector<Vec2> px;
  for (std::size_t i = 0; i < view.corners.size(); ++i) {
    if (!use[i]) continue;
    p_board.push_back(target.points[view.corners[i].point]);
    px.push_back(view.corners[i].px);
  }
  if (p_board.size() < 4) return std::nullopt;
  const auto pose = pose_from_points(lens, p_board, px);
  if (!pose) return std::nullopt;
  return *pose;
}

}  // namespace

std::optional<SE3> find_pose(const Lens& lens, const Target& target, const View& view, int most_corners) {
  constexpr double kLost = 1e6;
  std::vector<bool> use = spread_corners(view.corners.size(), most_corners);
  const auto first = pose_of_corners(lens, target, view, use);
  if (!first) return std::nullopt;
  const std::vector<double> errors = errors_px(lens, *first, target, view, kLost);
  // One corner far off bends a least-squares pose: leave out what is beyond six times the median, and keep
  // the new pose when most corners agree better with it.
  const double typical = median(errors), bound = 6 * typical + 1e-6;
  if (*std::max_element(errors.begin(), errors.end()) <= bound) return first;
  for (std::size_t i = 0; i < use.size(); ++i) use[i] = use[i] && errors[i] <= bound;
  const auto second = pose_of_corners(lens, target, view, use);
  return second && median(errors_px(lens, *second, target, view, kLost)) < typical ? second : first;
}

double robust_scale_px(const Calibration& cal) {
  std::vector<double> sizes;
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    if (!takes_part(cal, v)) continue;
    for (const CornerFit& fit : cal.fits[v]) {
      if (fit.outlier) continue;
      sizes.push_back(std::abs(fit.residual_px.x()));
      sizes.push_back(std::abs(fit.residual_px.y()));
    }
  }
  return std::max(0.3, 3 * 1.4826 * median(std::move(sizes)));
}

void bring_back(Calibration& cal) {
  for (auto& fits : cal.fits) {
    for (CornerFit& fit : fits) fit.outlier = false;
  }
  evaluate(cal);
}

// Gives each view the pose that fits better: the one it has or a fresh one for the present lens. Views
// without any leave.
void pose_views(Calibration& cal, Repose which, int most_corners) {
  const Lens& lens = cal.rig.cameras[0].lens;
  const double lost = 0.05 * diagonal_px(cal.rig.cameras[0].size);
  const auto rms_with = [&](const SE3& T, const View& view) {
    return rms(errors_px(lens, T, cal.data.targets[0], view, lost));
  };
  std::vector<double> now(cal.data.views.size(), INFINITY), posed;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    const View& view = cal.data.views[v];
    const std::optional<SE3>& pose = cal.T_rig_board[view.frame];
    if (view.corners.size() < 4 || !pose) continue;
    now[v] = rms_with(*pose, view);
    posed.push_back(now[v]);
  }
  const double good = which == Repose::kPoor ? 2 * median(std::move(posed)) : -1;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    const View& view = cal.data.views[v];
    if (view.corners.size() < 4) continue;
    std::optional<SE3>& pose = cal.T_rig_board[view.frame];
    if (!(now[v] <= good)) {
      const auto fresh = find_pose(lens, cal.data.targets[0], view, most_corners);
      if (fresh && (!pose || rms_with(*fresh, view) < now[v])) pose = fresh;
    }
    cal.fits[v].assign(pose ? view.corners.size() : 0, CornerFit{});
  }
  evaluate(cal);
}

// Views that take part share the mean; a view without a pose counts as lost.
double score_px(const Calibration& cal) {
  const double cap = 0.05 * diagonal_px(cal.rig.cameras[0].size);
  double sum = 0;
  int n = 0;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    const View& view = cal.data.views[v];
    if (view.corners.empty()) continue;
    const auto& pose = cal.T_rig_board[view.frame];
    const double e =
        pose ? rms(errors_px(cal.rig.cameras[0].lens, *pose, cal.data.targets[0], view, cap)) : cap;
    sum += e * e;
    ++n;
  }
  return n > 0 ? std::sqrt(sum / n) : cap;
}

}  // namespace plumbline::detail
