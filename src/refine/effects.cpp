// SPDX-License-Identifier: Apache-2.0
#include "refine/effects.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "plumbline/core/check.hpp"
#include "plumbline/core/linalg.hpp"
#include "plumbline/rig/motion.hpp"
#include "refine/recording.hpp"
#include "refine/solve.hpp"

namespace plumbline::detail {
namespace {

// One effect of a calibration: which of its parameters it is, and how to take it out.
struct Effect {
  std::string name;
  int first = 0, n = 0;  // in shared_parameter_names()
  std::function<VecX(const Calibration&)> value;
  std::function<void(Calibration&)> remove;
};

bool is_seen(const Dataset& data, int target) {
  return std::any_of(data.views.begin(), data.views.end(),
                     [&](const View& view) { return view.target == target && !view.corners.empty(); });
}

// Gives every board that can have a bow and has none a bow of zero.
std::vector<int> add_bows(Calibration& cal) {
  std::vector<int> added;
  cal.bow_m.resize(cal.data.targets.size());
  for (std::size_t i = 0; i < cal.data.targets.size(); ++i) {
    const int target = static_cast<int>(i);
    if (cal.bow_m[i] || !cal.data.targets[i].outline || !is_seen(cal.data, target)) continue;
    cal.bow_m[i] = Vec2(0, 0);
    added.push_back(target);
  }
  return added;
}

// A parameter of a camera's clock that is or is not there.
using ClockMember = std::optional<double> CameraClock::*;

// Gives the cameras from `first` on that have none a line delay or a time offset of zero.
std::vector<int> add_clock(Calibration& cal, ClockMember member, int first) {
  std::vector<int> added;
  cal.clocks.resize(cal.rig.cameras.size());
  for (std::size_t i = static_cast<std::size_t>(first); i < cal.clocks.size(); ++i) {
    if (cal.clocks[i].*member) continue;
    cal.clocks[i].*member = 0.0;
    added.push_back(static_cast<int>(i));
  }
  return added;
}

Effect clock_effect(const Calibration& cal, int cam, ClockMember member, const char* name, int first) {
  return {cal.rig.cameras[cam].name + " " + name, first, 1,
          [=](const Calibration& c) { return VecX(VecX::Constant(1, *(c.clocks[cam].*member))); },
          [=](Calibration& c) { (c.clocks[cam].*member).reset(); }};
}

std::vector<Effect> add_auto_effects(Calibration& cal, const RefineOptions& options) {
  std::vector<int> bowed, delayed, offset;
  if (options.bow == Estimate::kAuto) bowed = add_bows(cal);
  if (check_recording(cal)) {
    if (options.line_delay == Estimate::kAuto) delayed = add_clock(cal, &CameraClock::line_delay_s, 0);
    if (options.time_offset == Estimate::kAuto) offset = add_clock(cal, &CameraClock::time_offset_s, 1);
  }
  const Offsets offsets = offsets_of(cal);
  std::vector<Effect> effects;
  for (int target : bowed) {
    effects.push_back({cal.data.targets[target].name + " bow", offsets.bow[target], 2,
                       [target](const Calibration& c) { return VecX(*c.bow_m[target]); },
                       [target](Calibration& c) { c.bow_m[target].reset(); }});
  }
  for (int cam : delayed) {
    effects.push_back(
        clock_effect(cal, cam, &CameraClock::line_delay_s, "line_delay", offsets.line_delay[cam]));
  }
  for (int cam : offset) {
    effects.push_back(
        clock_effect(cal, cam, &CameraClock::time_offset_s, "time_offset", offsets.time_offset[cam]));
  }
  return effects;
}

// Lenses and poses of an optimum in the frames and views of the start, all of whose corners take part again.
Calibration from_optimum(const Calibration& start, const Calibration& optimum) {
  Calibration cal = start;
  cal.rig = optimum.rig;
  cal.T_board0_board = optimum.T_board0_board;
  cal.data = optimum.data;
  cal.bow_m = optimum.bow_m;
  cal.clocks = optimum.clocks;
  for (std::size_t f = 0; f < cal.T_rig_board.size(); ++f) {
    if (optimum.T_rig_board[f]) cal.T_rig_board[f] = optimum.T_rig_board[f];
  }
  return cal;
}

EffectTry judge(const Calibration& cal, const Effect& effect, double bound) {
  EffectTry tried{.effect = effect.name, .n_parameters = effect.n, .bound = bound};
  const MatX C = cal.covariance->block(effect.first, effect.first, effect.n, effect.n);
  const VecX b = effect.value(cal);
  const VecX scale = C.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const SymEigen eigen = sym_eigen(scale.asDiagonal() * C * scale.asDiagonal());
  const VecX z = eigen.vectors.transpose() * scale.cwiseProduct(b);
  tried.f = z.cwiseProduct(z).cwiseQuotient(eigen.values.cwiseMax(1e-12)).sum() / effect.n;
  // As many as the covariance was scaled by, but for the held parameters, which are few.
  int n_frames = 0;
  for (const auto& T : cal.T_rig_board) n_frames += T.has_value();
  const int n_free = static_cast<int>(cal.covariance->rows()) + 6 * n_frames;
  tried.p_value = chance_of_f(tried.f, effect.n, std::max(1, 2 * cal.stats.n_corners - n_free));
  tried.kept = tried.p_value < bound;
  return tried;
}

}  // namespace

double chance_of_f(double f, int n_effect, int n) {
  PLUMBLINE_CHECK(n_effect == 1 || n_effect == 2, "one or two parameters");
  if (!(f > 0)) return 1;
  if (n_effect == 2) return std::exp(-0.5 * n * std::log1p(2 * f / n));
  const double z = (8.0 * n + 1) / (8.0 * n + 3) * std::sqrt(n * std::log1p(f / n));
  return std::erfc(z / std::numbers::sqrt2);
}

Status add_wanted_effects(Calibration& start, const RefineOptions& options) {
  if (options.line_delay == Estimate::kYes) add_clock(start, &CameraClock::line_delay_s, 0);
  if (options.time_offset == Estimate::kYes) {
    if (start.rig.cameras.size() == 1) {
      return Error{ErrorCode::kInvalidData,
                   "one camera alone has no time offset: it is that to the first camera",
                   "camera " + start.rig.cameras[0].name};
    }
    add_clock(start, &CameraClock::time_offset_s, 1);
  }
  if (has_clocks(start)) {
    if (auto status = check_recording(start); !status) return status;
  }
  if (options.bow != Estimate::kYes) return {};
  add_bows(start);
  for (std::size_t i = 0; i < start.data.targets.size(); ++i) {
    if (bow_of(start, static_cast<int>(i))) return {};
  }
  return Error{ErrorCode::kInvalidData,
               "its points are not in the plane z = 0 of its own frame, and only a flat board has a bow",
               "target " + start.data.targets[0].name};
}

Result<Calibration> choose_effects(const Calibration& start, Calibration plain, const RefineOptions& options,
                                   const Finish& finish) {
  Calibration trial = from_optimum(start, plain);
  const std::vector<Effect> effects = add_auto_effects(trial, options);
  if (effects.empty()) return plain;
  const auto full = finish(std::move(trial));
  if (!full) {
    for (const Effect& effect : effects) {
      plain.stats.effects.push_back(
          {.effect = effect.name, .n_parameters = effect.n, .reason = full.error().text()});
    }
    return plain;
  }
  if (!full->covariance) {
    for (const Effect& effect : effects) {
      plain.stats.effects.push_back(
          {.effect = effect.name,
           .n_parameters = effect.n,
           .reason = "these lenses come without a covariance, which it is judged by"});
    }
    return plain;
  }
  std::vector<EffectTry> tries;
  for (const Effect& effect : effects)
    tries.push_back(judge(*full, effect, kFalseAlarm / static_cast<double>(effects.size())));
  const auto n_kept = std::count_if(tries.begin(), tries.end(), [](const EffectTry& t) { return t.kept; });
  Result<Calibration> chosen = std::move(plain);
  if (n_kept == std::ssize(tries)) {
    chosen = *full;
  } else if (n_kept > 0) {
    Calibration some = from_optimum(start, *full);
    for (std::size_t i = 0; i < effects.size(); ++i) {
      if (!tries[i].kept) effects[i].remove(some);
    }
    chosen = finish(std::move(some));
  }
  if (chosen) chosen->stats.effects = std::move(tries);
  return chosen;
}

}  // namespace plumbline::detail
