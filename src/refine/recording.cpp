// SPDX-License-Identifier: Apache-2.0
#include "refine/recording.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plumbline/rig/motion.hpp"
#include "refine/outliers.hpp"
#include "refine/solve.hpp"

namespace plumbline::detail {
namespace {

constexpr const char* kWhatToRecord =
    "from stills only the product of delay and velocity is seen; record 15 images or more a second, with "
    "their "
    "times, while the board (or the camera) moves smoothly";

Error degenerate(const std::string& fault) {
  return {ErrorCode::kDegenerate, fault + ": " + kWhatToRecord, "line delay and time offset"};
}

// The value at 0 of the cubic through (t_i, x_i).
Vec3 cubic_at_zero(const std::array<double, 4>& t, const std::array<Vec3, 4>& x) {
  Vec3 sum = Vec3::Zero();
  for (int i = 0; i < 4; ++i) {
    double weight = 1;
    for (int k = 0; k < 4; ++k) {
      if (k != i) weight *= -t[k] / (t[i] - t[k]);
    }
    sum += weight * x[i];
  }
  return sum;
}

}  // namespace

Status check_recording(const Calibration& cal) {
  int n_views = 0, n_without = 0;
  for (const View& view : cal.data.views) {
    if (view.corners.empty()) continue;
    ++n_views;
    n_without += !view.time_s;
  }
  if (n_without > 0)
    return degenerate(fmt::format("{} of {} views with corners have no time", n_without, n_views));
  Calibration posed = cal;  // as if every frame had a pose
  posed.T_rig_board.assign(cal.data.frames.size(), SE3());
  const Trajectory trajectory = trajectory_of(posed);
  if (std::any_of(trajectory.stencils.begin(), trajectory.stencils.end(),
                  [](const auto& stencil) { return stencil.has_value(); }))
    return {};
  std::vector<double> times;
  for (const auto& t : trajectory.time_s) {
    if (t) times.push_back(*t);
  }
  std::sort(times.begin(), times.end());
  std::vector<double> gaps;
  for (std::size_t i = 1; i < times.size(); ++i) gaps.push_back(times[i] - times[i - 1]);
  std::sort(gaps.begin(), gaps.end());
  return degenerate(
      fmt::format("of {} frames no {} follow one another within {} s (the median of the gaps is {:.3g} s)",
                  times.size(), kMotionFrames, kLongestGap_s, gaps.empty() ? 0.0 : gaps[gaps.size() / 2]));
}

Status check_moving(const Calibration& cal, const RefineOptions& options) {
  const auto unsupported = [](const std::string& what) {
    return Error{ErrorCode::kUnsupported, what + " cannot be had together with line delays and time offsets",
                 "options"};
  };
  if (!options.ties.empty()) return unsupported("ties");
  if (!options.priors.empty()) return unsupported("priors");
  for (const Camera& camera : cal.rig.cameras) {
    if (is_sparse(camera.lens)) return unsupported(fmt::format("the lens {}", lens_name(camera.lens)));
  }
  return {};
}

void drop_motionless(Calibration& cal) {
  const Trajectory trajectory = trajectory_of(cal);
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    if (!takes_part(cal, v) || trajectory.stencils[cal.data.views[v].frame]) continue;
    drop_view(
        cal, v,
        fmt::format("a motion is read from {} frames with no gap above {} s, and there are fewer around this",
                    kMotionFrames, kLongestGap_s));
  }
}

Status check_smoothness(const Calibration& cal) {
  const Trajectory trajectory = trajectory_of(cal);
  const Target& board = cal.data.targets[0];
  double defect = 0, moved = 0;
  int n = 0;
  for (const auto& stencil : trajectory.stencils) {
    if (!stencil || stencil->centre != 2) continue;
    const auto& [frames, t, centre] = *stencil;
    for (const Vec3& p : {board.points.front(), board.points.back()}) {
      const auto at = [&](int j) { return *cal.T_rig_board[frames[j]] * p; };
      const Vec3 expected = cubic_at_zero({t[0], t[1], t[3], t[4]}, {at(0), at(1), at(3), at(4)});
      defect += (expected - at(2)).squaredNorm();
      moved += 0.25 * (at(3) - at(1)).squaredNorm();
      ++n;
    }
  }
  if (n == 0 || defect <= kRoughest * kRoughest * moved) return {};
  return degenerate(
      fmt::format("the board moves by {:.3g} mm from frame to frame, and lies {:.3g} mm from where the "
                  "frames before and after "
                  "put it: it moves too abruptly for these frames, or hardly at all",
                  1e3 * std::sqrt(moved / n), 1e3 * std::sqrt(defect / n)));
}

}  // namespace plumbline::detail
