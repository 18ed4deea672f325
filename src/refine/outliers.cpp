// SPDX-License-Identifier: Apache-2.0
#include "refine/outliers.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plumbline/linear/pose.hpp"
#include "refine/solve.hpp"

namespace plumbline::detail {

namespace {

constexpr double kSmallestSigmaPx = 0.01;

double weight_of(const Corner& c, const RefineOptions& options) {
  return options.use_sigma ? 1.0 / c.sigma_px : 1.0;
}

std::vector<double> robust_sigmas(const Calibration& cal, const std::vector<std::vector<bool>>& lost,
                                  const RefineOptions& options) {
  std::vector<std::vector<double>> sizes(cal.rig.cameras.size());
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    if (!takes_part(cal, v)) continue;
    const View& view = cal.data.views[v];
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      if (lost[v][i]) continue;
      const Vec2 r = weight_of(view.corners[i], options) * cal.fits[v][i].residual_px;
      sizes[view.cam].push_back(std::abs(r.x()));
      sizes[view.cam].push_back(std::abs(r.y()));
    }
  }
  std::vector<double> sigmas;
  for (auto& list : sizes) {
    double middle = 0;
    if (!list.empty()) {
      const auto at = list.begin() + static_cast<std::ptrdiff_t>(list.size() / 2);
      std::nth_element(list.begin(), at, list.end());
      middle = *at;
    }
    sigmas.push_back(std::max(kSmallestSigmaPx, 1.4826 * middle));
  }
  return sigmas;
}

}  // namespace

void drop_view(Calibration& cal, std::size_t v, std::string reason) {
  cal.fits[v].clear();
  cal.view_reason[v] = std::move(reason);
  const int frame = cal.data.views[v].frame;
  for (std::size_t other = 0; other < cal.fits.size(); ++other) {
    if (cal.data.views[other].frame == frame && !cal.fits[other].empty()) return;
  }
  cal.T_rig_board[frame].reset();
}

namespace {

// Flags every corner anew by a bound of this many robust standard deviations.
struct Marking {
  bool changed = false;
  std::vector<double> bound;  // per camera
};
Marking mark(Calibration& cal, const RefineOptions& options, double n_sigmas) {
  std::vector<std::vector<bool>> before(cal.fits.size()), lost(cal.fits.size());
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    for (CornerFit& fit : cal.fits[v]) {
      before[v].push_back(fit.outlier);
      fit.outlier = false;
    }
  }
  evaluate(cal);
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    for (const CornerFit& fit : cal.fits[v]) lost[v].push_back(fit.outlier);
  }
  Marking marking{false, robust_sigmas(cal, lost, options)};
  for (double& bound : marking.bound) bound *= n_sigmas;
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    if (!takes_part(cal, v)) continue;
    const View& view = cal.data.views[v];
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      CornerFit& fit = cal.fits[v][i];
      fit.outlier = lost[v][i] ||
                    weight_of(view.corners[i], options) * fit.residual_px.norm() > marking.bound[view.cam];
      marking.changed = marking.changed || fit.outlier != before[v][i];
    }
  }
  return marking;
}

// A view that fits nowhere may have been posed by its wrong corners: the pose that at least half of its
// corners agree on, where no other view of the frame says where the board is.
bool pose_anew(Calibration& cal, std::size_t v, double bound_px) {
  const View& view = cal.data.views[v];
  for (std::size_t other = 0; other < cal.fits.size(); ++other) {
    if (other != v && takes_part(cal, other) && cal.data.views[other].frame == view.frame) return false;
  }
  std::vector<Vec3> p_board;
  std::vector<Vec2> px;
  for (const Corner& c : view.corners) {
    p_board.push_back(cal.data.targets[view.target].points[c.point]);
    px.push_back(c.px);
  }
  // With half of the corners right, 500 triples hold a right one but once in 10^28.
  const auto found = pose_ransac(cal.rig.cameras[view.cam].lens, p_board, px,
                                 {.inlier_px = bound_px, .max_hypotheses = 500, .seed = v});
  if (!found || 2 * found->consensus.n_inliers < static_cast<int>(px.size())) return false;
  cal.T_rig_board[view.frame] =
      cal.rig.T_cam_rig[view.cam].inverse() * found->model * cal.T_board0_board[view.target].inverse();
  for (std::size_t i = 0; i < px.size(); ++i) cal.fits[v][i].outlier = !found->consensus.inlier[i];
  return true;
}

std::size_t n_kept(const std::vector<CornerFit>& fits) {
  return static_cast<std::size_t>(
      std::count_if(fits.begin(), fits.end(), [](const CornerFit& fit) { return !fit.outlier; }));
}

}  // namespace

bool mark_outliers(Calibration& cal, const RefineOptions& options) {
  Marking marking = mark(cal, options, options.outlier_sigma);
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    if (!takes_part(cal, v)) continue;
    const View& view = cal.data.views[v];
    const std::size_t n = n_kept(cal.fits[v]);
    if (n >= 4 && 4 * n >= view.corners.size()) continue;
    marking.changed = true;
    const double bound = marking.bound[view.cam];
    if (!options.use_sigma && pose_anew(cal, v, bound)) continue;
    drop_view(cal, v,
              fmt::format("only {} of its {} corners agree with the other views to {:.2g} px", n,
                          view.corners.size(), bound));
  }
  return marking.changed;
}

void mark_gross(Calibration& cal, const RefineOptions& options) {
  mark(cal, options, 4 * options.outlier_sigma);
}

double truncated_variance(double k) {
  const double a = 0.5 * k * k;
  return a < 1e-6 ? 0.5 * a : 1 - a / std::expm1(a);
}

}  // namespace plumbline::detail
