// SPDX-License-Identifier: Apache-2.0
#include "refine/lens_trial.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "plumbline/lens/range.hpp"
#include "refine/seed.hpp"
#include "refine/solve.hpp"

namespace plumbline::detail {
namespace {

// The options for one camera alone: of what they say of single parameters, what this camera with this lens
// has; the rest concerns other cameras, boards or lenses.
RefineOptions options_alone(const RefineOptions& options, const Calibration& alone) {
  RefineOptions out = options;
  out.lenses = {std::string(lens_name(alone.rig.cameras[0].lens))};
  out.only.clear();
  const auto fits = [&](const auto& set) {
    RefineOptions one;
    set(one);
    return constraints_of(alone, one).has_value();
  };
  std::erase_if(out.fixed, [&](const std::string& name) {
    return !fits([&](RefineOptions& one) { one.fixed = {name}; });
  });
  std::erase_if(out.ties,
                [&](const std::string& tie) { return !fits([&](RefineOptions& one) { one.ties = {tie}; }); });
  std::erase_if(out.priors,
                [&](const Prior& prior) { return !fits([&](RefineOptions& one) { one.priors = {prior}; }); });
  return out;
}

// The spread of the residuals, marked corners too [px]: what tells fits apart that marked different corners.
double spread_px(const Calibration& cal) {
  std::vector<double> sizes;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    for (std::size_t i = 0; i < cal.data.views[v].corners.size(); ++i) {
      const auto px = predict(cal, cal.data.views[v], cal.data.views[v].corners[i].point);
      sizes.push_back(px ? (*px - cal.data.views[v].corners[i].px).norm()
                         : std::numeric_limits<double>::infinity());
    }
  }
  if (sizes.empty()) return std::numeric_limits<double>::infinity();
  // Nine tenths: a lens that is wrong at the rim is wrong there only.
  const auto at = sizes.begin() + static_cast<std::ptrdiff_t>(0.9 * static_cast<double>(sizes.size() - 1));
  std::nth_element(sizes.begin(), at, sizes.end());
  return *at;
}

SolveSpec spec_of(const Calibration& cal, const RefineOptions& options, const Constraints& constraints) {
  return with_constraints({.loss = options.loss,
                           .loss_scale = options.loss_scale_px,
                           .use_sigma = options.use_sigma,
                           .max_iterations = std::min(60, options.max_iterations),
                           .tight = false,
                           .prior_weight = robust_scale_px(cal) / 3,
                           .solver = options.solver,
                           .n_threads = options.n_threads},
                          constraints);
}

// The optimum on the marks and views of `marked`, from where `cal` is. Corners that the lens does not project
// at first are left out and tried again. \returns how many it does not project in the end
int solve_on_marks(Calibration& cal, const Calibration& marked, const RefineOptions& options,
                   const Constraints& constraints) {
  cal.view_reason = marked.view_reason;
  for (std::size_t f = 0; f < cal.T_rig_board.size(); ++f) {
    if (!marked.T_rig_board[f])
      cal.T_rig_board[f].reset();
    else if (!cal.T_rig_board[f])
      cal.T_rig_board[f] = marked.T_rig_board[f];
  }
  int lost = 0;
  for (int round = 0; round < 3; ++round) {
    cal.fits = marked.fits;
    lost = evaluate(cal);
    if (round > 0 && lost == 0) break;
    Calibration solved = cal;
    if (!solve(solved, spec_of(cal, options, constraints)).usable) break;
    cal = std::move(solved);
    cal.fits = marked.fits;
    lost = evaluate(cal);
    if (lost == 0) break;
  }
  return lost;
}

// Where to start a lens from a fit of another: its focal lengths and centre; the parameters of the same names
// too, which is a start where both are of one kind; a fisheye's profile for a lens that looks forward. The
// one that fits the boards as they stand.
Lens start_lens(const Calibration& from, const std::string& name, const Constraints& constraints) {
  const Camera& camera = from.rig.cameras[0];
  const auto k = params(camera.lens);
  std::vector<Lens> starts(2, *make_lens(name, camera.size, k[0]));
  for (Lens& lens : starts) std::copy_n(k.begin(), 4, params(lens).begin());
  const auto names = param_names(starts[1]), known = param_names(camera.lens);
  for (std::size_t i = 4; i < names.size(); ++i) {
    const auto at = std::find(known.begin(), known.end(), names[i]);
    if (at != known.end()) params(starts[1])[i] = k[static_cast<std::size_t>(at - known.begin())];
  }
  if (!is_central_perspective(camera.lens) && is_central_perspective(starts[0])) {
    std::vector<double> theta;
    for (double angle = 0.02; angle < 1.5; angle += 0.02) theta.push_back(angle);
    if (auto like = perspective_like(camera.lens, name, camera.size, theta, constraints.held))
      starts.push_back(*like);
  }
  for (Lens& lens : starts) apply(lens, constraints);
  Calibration trial = from;
  const auto score = [&](const Lens& lens) {
    trial.rig.cameras[0].lens = lens;
    return score_px(trial);
  };
  return *std::min_element(starts.begin(), starts.end(),
                           [&](const Lens& a, const Lens& b) { return score(a) < score(b); });
}

// A fit from the boards of another: the lens alone first, then everything.
Calibration carried_over(const Calibration& from, const std::string& name, const RefineOptions& options,
                         const Constraints& constraints) {
  Calibration cal = from;
  cal.rig.cameras[0].lens = start_lens(from, name, constraints);
  cal.rig.cameras[0].validity.reset();
  evaluate(cal);
  SolveSpec lens_only = spec_of(cal, options, constraints);
  lens_only.loss = Loss::kCauchy;
  lens_only.loss_scale = robust_scale_px(cal);
  lens_only.hold_boards = true;
  Calibration solved = cal;
  if (solve(solved, lens_only).usable) cal = std::move(solved);
  return cal;
}

// Whether a lens that looks forward may have trouble with these corners: 40 degrees off its axis, or
// corners that it gave up.
bool sees_far(const Calibration& cal) {
  int n = 0, n_out = 0;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    const View& view = cal.data.views[v];
    n += static_cast<int>(view.corners.size());
    if (cal.fits[v].empty()) n_out += static_cast<int>(view.corners.size());
    if (!takes_part(cal, v)) continue;
    const SE3 T = *board_pose(cal, view);
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      const Vec3 p = T * cal.data.targets[view.target].points[view.corners[i].point];
      n_out += cal.fits[v][i].outlier;
      if (p.head<2>().norm() > 0.84 * p.z()) return true;  // tan 40 degrees
    }
  }
  return 20 * n_out > n;
}

}  // namespace

LensFitter::LensFitter(const Dataset& mono, const RefineOptions& options) : mono_(mono), options_(options) {
  for (const char* name : {"opencv5", "kb4"}) {
    if (!bases_.empty() && !sees_far(bases_.front())) break;  // an ordinary lens: one start is enough
    auto fit = calibrate(mono_, options_of(name));
    if (fit)
      bases_.push_back(*std::move(fit));
    else
      error_ = fit.error();
  }
  std::stable_sort(bases_.begin(), bases_.end(),
                   [](const Calibration& a, const Calibration& b) { return spread_px(a) < spread_px(b); });
}

RefineOptions LensFitter::options_of(const std::string& name) const {
  const auto lens = make_lens(name, mono_.cameras[0].size, mono_.cameras[0].size.width);
  return options_alone(options_, empty_calibration(mono_, {*lens}));
}

Calibration LensFitter::near_fit(const std::string& name, const Constraints& constraints) const {
  for (const Calibration& base : bases_) {
    if (lens_name(base.rig.cameras[0].lens) == name) return base;
  }
  return carried_over(bases_.front(), name, options_, constraints);
}

LensTrial LensFitter::fit(const std::string& name) const {
  LensTrial trial;
  trial.row.camera = mono_.cameras[0].name;
  trial.row.lens = name;
  const auto lens = make_lens(name, mono_.cameras[0].size, mono_.cameras[0].size.width);
  if (!lens) {
    trial.row.reason = lens.error().message;
    return trial;
  }
  trial.row.n_params = n_params(*lens);
  const RefineOptions alone = options_of(name);
  trial.constraints = *constraints_of(empty_calibration(mono_, {*lens}), alone);
  trial.fit = near_fit(name, trial.constraints);
  int lost = solve_on_marks(*trial.fit, bases_.front(), options_, trial.constraints);
  // A lens with as many terms that fits much worse may sit in a wrong valley.
  const bool suspicious = trial.row.n_params >= n_params(bases_.front().rig.cameras[0].lens) &&
                          (lost > 0 || camera_rms_px(*trial.fit, 0) > 1.3 * camera_rms_px(bases_.front(), 0));
  if (suspicious) {
    if (auto again = calibrate(mono_, alone)) {
      const int lost_again = solve_on_marks(*again, bases_.front(), options_, trial.constraints);
      if (lost_again < lost ||
          (lost_again == lost && camera_rms_px(*again, 0) < camera_rms_px(*trial.fit, 0))) {
        trial.fit = *std::move(again);
        lost = lost_again;
      }
    }
  }
  trial.row.rms_px = camera_rms_px(*trial.fit, 0);
  if (lost > 0) {
    trial.row.reason = fmt::format("{} of the corners lie outside its domain", lost);
    trial.fit.reset();
  } else if (const std::string why = out_of_range(trial.fit->rig.cameras[0].lens); !why.empty()) {
    trial.row.reason = why;
    trial.fit.reset();
  }
  return trial;
}

double LensFitter::cap() const {
  std::vector<double> sizes;
  const Calibration& cal = bases_.front();
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    for (std::size_t i = 0; i < cal.fits[v].size(); ++i) {
      const double weight = options_.use_sigma ? 1 / cal.data.views[v].corners[i].sigma_px : 1;
      if (cal.fits[v][i].outlier) continue;
      for (double r : cal.fits[v][i].residual_px) sizes.push_back(weight * std::abs(r));
    }
  }
  const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  return 4 * 1.4826 * std::max(*middle, 1e-3);  // data without noise
}

}  // namespace plumbline::detail
