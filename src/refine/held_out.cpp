// SPDX-License-Identifier: Apache-2.0
#include "refine/held_out.hpp"

#include <algorithm>

#include "plumbline/core/linalg.hpp"
#include "refine/reduced.hpp"
#include "refine/seed.hpp"

namespace plumbline::detail {
namespace {

constexpr int kFolds = 5;
constexpr int kLeastViews = 6;  // a fold leaves out two of them at most, and three are needed to go on

std::vector<std::size_t> views_of(const Calibration& cal) {
  std::vector<std::size_t> views;
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    if (takes_part(cal, v)) views.push_back(v);
  }
  return views;
}

SolveSpec spec_of(const Calibration& fit, const RefineOptions& options, const Constraints& constraints) {
  return with_constraints({.loss = options.loss,
                           .loss_scale = options.loss_scale_px,
                           .use_sigma = options.use_sigma,
                           .max_iterations = 50,
                           .tight = false,
                           .prior_weight = robust_scale_px(fit) / 3,
                           .solver = options.solver,
                           .n_threads = options.n_threads},
                          constraints);
}

// Squared residual of a corner, at most the cap's; a corner that does not project counts with the cap.
double squared(const Calibration& cal, std::size_t v, std::size_t i, bool use_sigma, double cap) {
  const Corner& corner = cal.data.views[v].corners[i];
  const auto px = predict(cal, cal.data.views[v], corner.point);
  if (!px) return cap * cap;
  return std::min(cap * cap,
                  (*px - corner.px).squaredNorm() / (use_sigma ? corner.sigma_px * corner.sigma_px : 1.0));
}

// The views of one fold, predicted with their poses refined.
bool predict_views(const Calibration& fit, const Calibration& trained,
                   const std::vector<std::size_t>& left_out, const RefineOptions& options, double cap,
                   std::vector<HeldOut>& out) {
  Calibration test = fit;
  test.rig = trained.rig;
  for (auto& fits : test.fits) fits.clear();
  for (std::size_t v : left_out) test.fits[v] = fit.fits[v];
  const auto n = static_cast<std::size_t>(n_params(test.rig.cameras[0].lens));
  // With all corners of a view in its pose, a loss would only hide what the lens gets wrong.
  Constraints all_held;
  all_held.held.assign(n, true);
  SolveSpec spec = spec_of(fit, options, all_held);
  spec.loss = Loss::kSquared;
  if (!solve(test, spec).usable) return false;
  for (std::size_t v : left_out) {
    HeldOut& view = out[v];
    view.n_free = -6;
    for (std::size_t i = 0; i < fit.fits[v].size(); ++i) {
      if (fit.fits[v][i].outlier) continue;
      view.sum_sq += squared(test, v, i, options.use_sigma, cap);
      view.n_free += 2;
    }
  }
  return true;
}

std::optional<std::vector<HeldOut>> by_views(const Calibration& fit, const std::vector<std::size_t>& views,
                                             const RefineOptions& options, const Constraints& constraints,
                                             double cap) {
  std::vector<HeldOut> errors(fit.fits.size());
  for (int fold = 0; fold < kFolds; ++fold) {
    Calibration trained = fit;
    std::vector<std::size_t> left_out;
    for (std::size_t i = static_cast<std::size_t>(fold); i < views.size(); i += kFolds) {
      left_out.push_back(views[i]);
      trained.fits[views[i]].clear();
    }
    if (left_out.empty()) continue;
    if (!solve(trained, spec_of(fit, options, constraints)).usable) return std::nullopt;
    if (!predict_views(fit, trained, left_out, options, cap, errors)) return std::nullopt;
  }
  std::vector<HeldOut> out;
  for (const HeldOut& view : errors) {
    if (view.n_free > 0) out.push_back(view);
  }
  return out;
}

// The same without solving: without the views F the normal equations are (S - S_F) d = -(g - g_F), and what a
// view makes of the step d is in its own derivatives.
std::optional<std::vector<HeldOut>> by_views_linear(const Calibration& fit, const RefineOptions& options,
                                                    const Constraints& constraints, double cap) {
  std::vector<PoseFreeFrame> frames;
  for_each_pose_free_frame(fit, spec_of(fit, options, constraints),
                           [&](const PoseFreeFrame& frame) { frames.push_back(frame); });
  std::vector<int> free;
  for (std::size_t i = 0; i < constraints.held.size(); ++i) {
    if (!constraints.held[i]) free.push_back(static_cast<int>(i));
  }
  if (free.empty() || frames.empty()) return std::nullopt;
  const Eigen::Index n = frames[0].J.cols();
  std::vector<HeldOut> errors(frames.size());
  for (std::size_t fold = 0; fold < kFolds; ++fold) {
    MatX S = MatX::Zero(n, n);
    VecX g = VecX::Zero(n);
    for (std::size_t i = 0; i < frames.size(); ++i) {
      if (i % kFolds == fold) continue;
      S.noalias() += frames[i].J.transpose() * frames[i].J;
      g.noalias() += frames[i].J.transpose() * frames[i].r;
    }
    const MatX S_free = S(free, free);
    const VecX scale = S_free.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    const auto step =
        solve_spd(scale.asDiagonal() * S_free * scale.asDiagonal(), -scale.cwiseProduct(g(free)));
    if (!step) return std::nullopt;
    VecX d = VecX::Zero(n);
    d(free) = scale.cwiseProduct(VecX(*step));
    for (std::size_t i = fold; i < frames.size(); i += kFolds) {
      const VecX r = frames[i].r + frames[i].J * d;
      for (Eigen::Index k = 0; k + 1 < r.size(); k += 2)
        errors[i].sum_sq += std::min(cap * cap, r.segment<2>(k).squaredNorm());
      errors[i].n_free = static_cast<double>(r.size()) - 6;
    }
  }
  std::erase_if(errors, [](const HeldOut& view) { return !(view.n_free > 0); });
  return errors;
}

std::optional<std::vector<HeldOut>> by_corners(const Calibration& fit, const std::vector<std::size_t>& views,
                                               const RefineOptions& options, const Constraints& constraints,
                                               double cap) {
  std::vector<HeldOut> errors;
  for (int fold = 0; fold < kFolds; ++fold) {
    Calibration trained = fit;
    const auto left_out = [&](std::size_t v, std::size_t i) {
      return !fit.fits[v][i].outlier && static_cast<int>((i + v) % kFolds) == fold;
    };
    for (std::size_t v : views) {
      for (std::size_t i = 0; i < fit.fits[v].size(); ++i)
        trained.fits[v][i].outlier = fit.fits[v][i].outlier || left_out(v, i);
    }
    if (!solve(trained, spec_of(fit, options, constraints)).usable) return std::nullopt;
    for (std::size_t v : views) {
      for (std::size_t i = 0; i < fit.fits[v].size(); ++i) {
        if (!left_out(v, i)) continue;
        errors.push_back({squared(trained, v, i, options.use_sigma, cap), 2});
      }
    }
  }
  return errors;
}

}  // namespace

std::optional<std::vector<HeldOut>> held_out_errors(const Calibration& fit, const RefineOptions& options,
                                                    const Constraints& constraints, double cap, Refit refit) {
  constexpr int kManyViews = 21;  // the fifth left out moves the lens by half a sigma: a small step
  const std::vector<std::size_t> views = views_of(fit);
  const int n = static_cast<int>(views.size());
  if (n < kLeastViews) return by_corners(fit, views, options, constraints, cap);
  if (refit == Refit::kAuto)
    refit =
        n >= kManyViews && options.loss == Loss::kSquared && options.ties.empty() && options.priors.empty()
            ? Refit::kLinear
            : Refit::kSolve;
  return refit == Refit::kLinear ? by_views_linear(fit, options, constraints, cap)
                                 : by_views(fit, views, options, constraints, cap);
}

}  // namespace plumbline::detail
