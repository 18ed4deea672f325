// SPDX-License-Identifier: Apache-2.0
#include "refine/monotonic.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "plumbline/core/text.hpp"
#include "plumbline/rig/motion.hpp"
#include "plumbline/rig/validity.hpp"
#include "refine/radial_guard.hpp"

namespace plumbline::detail {
namespace {

constexpr double kMargin = 1.05;  // of the angle of the outermost corner
// Four sigma: the constraint binds two or three terms at once, of which one in a thousand data sets
// contradicts the truth by so much.
constexpr double kMostChiSquared = 16;
// A map may flatten towards the rim, and real ones do: an equidistant lens by a factor of 4 at 60 degrees on
// the plane z = 1. A tenth of the mean slope inside the corners is far from any glass and still no turn.
constexpr double kLeastSlope = 0.05;
constexpr double kDegPerRad = 180 / std::numbers::pi;
constexpr double kPi = std::numbers::pi;

// The angle from the axis of the outermost corner that takes part [rad].
double data_angle_rad(const Calibration& cal, int cam) {
  double widest = 0;
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    const View& view = cal.data.views[v];
    if (view.cam != cam || !takes_part(cal, v)) continue;
    const SE3 T_cam_board = cal.rig.T_cam_rig[cam] * *board_pose(cal, view);
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      if (cal.fits[v][i].outlier) continue;
      const Vec3 p = T_cam_board * cal.data.targets[view.target].points[view.corners[i].point];
      widest = std::max(widest, std::atan2(p.head<2>().norm(), p.z()));
    }
  }
  return widest;
}

// A guard from just inside the outermost corner to where the border of the image would lie if the map went on
// straight, `stretch` times as far.
RadialGuard guard_of(const Camera& camera, int cam, double data_rad, double stretch) {
  const bool forward = is_central_perspective(camera.lens);
  const auto distance = [&](double angle) { return forward ? std::tan(angle) : angle; };
  const double reach = std::min(data_rad, 0.999 * domain_angle_rad(camera.lens)),
               from = 0.9 * distance(reach);
  const double radius_px = validity_of(camera.lens, forward ? std::atan(from) : from).radius_px;
  const double slope_px = radius_px / from;
  RadialGuard guard{cam, from, {}, kLeastSlope * slope_px};
  const auto k = params(camera.lens);
  const Vec2 centre(k[2], k[3]), last(camera.size.width - 1, camera.size.height - 1);
  for (int i = 0; i < kGuardDirections; ++i) {
    const Vec2 out(std::cos(i * kPi / 4), std::sin(i * kPi / 4));
    // To the farthest corner of the picture that lies on that side, so that all of it is covered.
    double border_px = 0;
    for (const Vec2& px : {Vec2(0, 0), Vec2(last.x(), 0), Vec2(0, last.y()), last}) {
      const Vec2 d = px - centre;
      if (d.normalized().dot(out) > std::cos(kPi / 8 + 0.4)) border_px = std::max(border_px, d.norm());
    }
    const double there = from + stretch * std::max(0.1 * from, (border_px - radius_px) / slope_px);
    guard.to[i] = forward ? there : std::min(there, 0.999 * kPi);
  }
  return guard;
}

struct Constrained {
  Calibration calibration;
  SolveReport report;
  RadialGuard guard;
};

// The fit with two terms of distortion: a rational lens with a pole beside its corners cannot leave it by
// small steps, and a guard whose samples lie on both sides of a pole does not see it. From the two terms as
// they are, or, where those mean nothing without the denominator, from none.
std::optional<Calibration> simpler_fit(const Calibration& free, const SolveSpec& spec, int cam) {
  SolveSpec held = spec;
  const Offsets offsets = offsets_of(free);
  const int first = offsets.lens[cam];
  held.held.resize(static_cast<std::size_t>(offsets.total), false);
  held.tight = false;
  for (const std::size_t kept : {6, 4}) {
    Calibration cal = free;
    const auto k = params(cal.rig.cameras[cam].lens);
    for (std::size_t i = kept; i < k.size(); ++i) {
      const bool stays = !spec.held.empty() && spec.held[static_cast<std::size_t>(first) + i];
      if (!stays) k[i] = 0;
      held.held[static_cast<std::size_t>(first) + i] = stays || i >= 6;
    }
    if (solve(cal, held).usable) return cal;
  }
  return std::nullopt;
}

std::optional<Constrained> constrained_fit(const Calibration& free, const SolveSpec& spec, int cam,
                                           double data_rad) {
  if (!can_guard(free.rig.cameras[cam].lens)) return std::nullopt;
  bool has_ties = false;  // those hold and move together
  for (std::size_t i = 0; i < spec.tied_to.size(); ++i) has_ties |= spec.tied_to[i] != static_cast<int>(i);
  for (const bool simple : {false, true}) {
    if (simple && has_ties) break;
    const std::optional<Calibration> start = simple ? simpler_fit(free, spec, cam) : free;
    if (!start) break;
    for (double stretch : {1.0, 1.6, 2.6}) {
      Constrained trial{*start, {}, guard_of(start->rig.cameras[cam], cam, data_rad, stretch)};
      SolveSpec guarded = spec;
      guarded.guards.push_back(trial.guard);
      trial.report = solve(trial.calibration, guarded);
      if (!trial.report.usable) break;
      if (!folds_in_image(trial.calibration.rig.cameras[cam])) return trial;
    }
  }
  return std::nullopt;
}

// Of one residual coordinate.
double variance_of(const Calibration& cal, const SolveSpec& spec, const SolveReport& report) {
  for (const Camera& camera : cal.rig.cameras) {
    if (is_sparse(camera.lens)) return residual_variance(cal, spec);  // the cost has its regularisation too
  }
  const Reduction reduction = reduction_of(spec, offsets_of(cal).total);
  const PriorRows priors = prior_rows(cal, spec);
  const PriorScatter scatter = scatter_of(priors, reduction);
  int n = scatter.n, n_free = reduction.n_free;
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    if (!takes_part(cal, v)) continue;
    for (const CornerFit& fit : cal.fits[v]) n += fit.outlier ? 0 : 2;
  }
  for (const auto& T : cal.T_rig_board) n_free += T ? 6 : 0;
  const double constant = priors.r.squaredNorm() - scatter.sum;  // in the cost
  return (2 * report.cost - constant) / std::max(1, n - n_free);
}

VecX lens_step(const Calibration& from, const Calibration& to, int cam) {
  const auto a = params(from.rig.cameras[cam].lens), b = params(to.rig.cameras[cam].lens);
  VecX step(static_cast<Eigen::Index>(a.size()));
  for (std::size_t i = 0; i < a.size(); ++i) step[static_cast<Eigen::Index>(i)] = b[i] - a[i];
  return step;
}

std::string what_turns(const Camera& camera, double data_rad) {
  const Fold fold = fold_of(camera.lens);
  const Validity data = validity_of(camera.lens, data_rad);
  return fmt::format(
      "no corner of camera {} lies more than {:.1f} degrees ({:.0f} px) from its axis, and lens {} fitted to "
      "them {} at {:.1f} degrees ({:.0f} px), inside the picture",
      camera.name, data_rad * kDegPerRad, data.radius_px, lens_name(camera.lens),
      fold.is_pole ? "runs off to infinity (its denominator has a pole)" : "turns back",
      fold.end.angle_rad * kDegPerRad, fold.end.radius_px);
}

std::string why_not_held(bool has_clocks, const std::optional<Constrained>& trial, double chi_squared) {
  if (has_clocks) return "a constrained fit is not tried together with line delays and time offsets";
  if (!trial) return "no map that rises over the whole picture was found";
  if (!trial->report.converged)
    return fmt::format("the fit of a map that rises over the whole picture did not arrive in {} iterations",
                       trial->report.iterations);
  return fmt::format("a map that rises over the whole picture contradicts the corners (chi-squared {:.3g})",
                     chi_squared);
}

bool is_wholly_held(const Calibration& cal, const SolveSpec& spec, int cam) {
  if (spec.held.empty()) return false;
  const auto first = spec.held.begin() + offsets_of(cal).lens[cam];
  return std::all_of(first, first + n_params(cal.rig.cameras[cam].lens), [](bool held) { return held; });
}

constexpr const char* kNextStep =
    "add images with the board in the corners of the picture, or choose a lens "
    "with fewer terms";

}  // namespace

std::vector<MonotonicNote> keep_monotonic(Calibration& cal, const SolveSpec& spec, SolveReport& report) {
  std::vector<MonotonicNote> notes;
  SolveSpec guarded = spec;
  for (int cam = 0; cam < static_cast<int>(cal.rig.cameras.size()); ++cam) {
    Camera& camera = cal.rig.cameras[cam];
    if (is_wholly_held(cal, spec, cam)) continue;  // what is known of it stays true
    camera.validity.reset();
    // A spline ends where its grid does, and says so itself.
    if (is_sparse(camera.lens) || !folds_in_image(camera)) continue;
    const double data_rad = data_angle_rad(cal, cam);
    if (!(data_rad > 0)) continue;
    MonotonicNote note{cam, false, VecX::Zero(n_params(camera.lens)), what_turns(camera, data_rad)};
    // The solver of recordings knows no guards.
    auto trial = has_clocks(cal) ? std::nullopt : constrained_fit(cal, guarded, cam, data_rad);
    // The cost of a fit that stopped on its way says nothing of what the corners contradict.
    const bool arrived = trial && trial->report.converged;
    const double variance = variance_of(cal, spec, report);
    const double chi_squared =
        arrived && variance > 0 ? 2 * (trial->report.cost - report.cost) / variance : INFINITY;
    if (trial) note.moved = lens_step(cal, trial->calibration, cam);
    if (chi_squared <= kMostChiSquared) {
      note.held = true;
      note.consequence += fmt::format(
          "; it was held to a map that rises over the whole picture, which the corners do not contradict "
          "(chi-squared {:.2g}), but nothing measures it there; {}",
          std::max(0.0, chi_squared), kNextStep);
      guarded.guards.push_back(trial->guard);
      report.iterations += trial->report.iterations;
      report.cost = trial->report.cost;
      report.termination = trial->report.termination;
      report.converged = trial->report.converged;
      cal = std::move(trial->calibration);
    } else {
      const double turn_rad = std::max(data_rad, fold_of(camera.lens).end.angle_rad);
      camera.validity = validity_of(camera.lens, std::min(kMargin * data_rad, turn_rad));
      note.consequence += fmt::format(
          "; {}: the calibration holds up to {:.1f} degrees ({:.0f} px), and later steps leave out what lies "
          "beyond; {}",
          why_not_held(has_clocks(cal), trial, chi_squared), camera.validity->angle_rad * kDegPerRad,
          camera.validity->radius_px, kNextStep);
    }
    notes.push_back(std::move(note));
  }
  return notes;
}

void add_notes(Calibration& cal, const std::vector<MonotonicNote>& notes) {
  const std::vector<std::string> names = shared_parameter_names(cal);
  const Offsets offsets = offsets_of(cal);
  std::vector<WeakDirection> weak;
  std::vector<std::string> held;
  const auto sigma_of = [&](int at) {  // a rig with a splined lens has none
    return cal.covariance ? std::sqrt(std::max(0.0, (*cal.covariance)(at, at))) : 0.0;
  };
  for (const MonotonicNote& note : notes) {
    // The term of distortion that moved farthest, in its own sigmas.
    int which = offsets.lens[note.cam];
    double farthest = -1;
    for (int i = 4; i < note.moved.size(); ++i) {
      const int at = offsets.lens[note.cam] + i;
      const double sigma = sigma_of(at);
      const double sigmas = sigma > 0 ? std::abs(note.moved[i]) / sigma : 0;
      if (sigmas <= farthest) continue;
      farthest = sigmas;
      which = at;
    }
    weak.push_back({names[which], sigma_of(which), note.consequence});
    if (note.held) held.push_back(cal.rig.cameras[note.cam].name);
  }
  if (!held.empty()) cal.provenance.options["held_monotonic"] = join(held, ",");
  cal.stats.weak.insert(cal.stats.weak.begin(), weak.begin(), weak.end());
}

}  // namespace plumbline::detail
