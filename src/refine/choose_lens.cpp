// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/choose_lens.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "plumbline/core/check.hpp"
#include "refine/lens_eligible.hpp"
#include "refine/lens_trial.hpp"
#include "refine/seed.hpp"

namespace plumbline {
namespace {

using namespace detail;

constexpr int kMostParams = 20;             // a spline has hundreds and is not one of the family
constexpr double kHopelessRatio = 3;        // times the least RMS: no chance in the comparison
constexpr double kStandardErrors = 2;       // by which the least error must be better to cost parameters
constexpr double kNoDifference_px2 = 1e-8;  // no corner finder sees 1e-4 px: for data without noise

std::vector<std::string> family(const std::vector<std::string>& wanted) {
  if (!wanted.empty()) return wanted;
  std::vector<std::string> names;
  for (std::string_view name : lens_names()) {
    const auto lens = make_lens(name, ImageSize{640, 480}, 500);
    if (lens && n_params(*lens) < kMostParams) names.emplace_back(name);
  }
  return names;
}

// Mean squared error of a residual coordinate that is free.
double mean_square(const std::vector<HeldOut>& errors) {
  double sum = 0, n = 0;
  for (const HeldOut& e : errors) sum += e.sum_sq, n += e.n_free;
  return n > 0 ? sum / n : 0;
}

// Mean difference a - b of the squared errors and its standard error, each thing left out weighted with its
// residuals.
std::pair<double, double> difference(const std::vector<HeldOut>& a, const std::vector<HeldOut>& b) {
  double n = 0, sum = 0, squares = 0;
  for (std::size_t i = 0; i < a.size(); ++i) n += a[i].n_free, sum += a[i].sum_sq - b[i].sum_sq;
  const double mean = sum / n;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double off = a[i].sum_sq - b[i].sum_sq - mean * a[i].n_free;
    squares += off * off;
  }
  const double count = static_cast<double>(a.size());
  return {mean, std::sqrt(squares * count / std::max(1.0, count - 1)) / n};
}

// Fills the comparison with the best.
void compare(std::vector<LensTrial>& trials) {
  const LensTrial* best = nullptr;
  for (const LensTrial& t : trials) {
    if (!t.errors.empty() && (!best || mean_square(t.errors) < mean_square(best->errors))) best = &t;
  }
  if (!best) return;
  const double least = mean_square(best->errors);
  for (LensTrial& t : trials) {
    if (t.errors.empty()) continue;
    t.row.held_out_px = std::sqrt(2 * mean_square(t.errors));
    const auto [mean, sigma] = difference(t.errors, best->errors);
    t.row.excess = least > 0 ? mean / least : 0;
    t.row.excess_sigma = least > 0 ? sigma / least : 0;
  }
}

// Whether the data do not tell a lens from the best.
bool as_good(const LensTry& t) {
  if (!(t.held_out_px > 0)) return false;
  const double difference_px2 = 0.5 * t.held_out_px * t.held_out_px * t.excess / (1 + t.excess);
  return t.excess <= kStandardErrors * t.excess_sigma || difference_px2 <= kNoDifference_px2;
}

std::pair<int, double> rank_of(const LensTry& t) { return {t.n_params, t.held_out_px}; }

const LensTry* simplest(const std::vector<LensTry>& rows) {
  const LensTry* chosen = nullptr;
  for (const LensTry& t : rows) {
    if (as_good(t) && (!chosen || rank_of(t) < rank_of(*chosen))) chosen = &t;
  }
  return chosen;
}

// A lens that is as good as the best for every camera, with no more parameters than one of them needs by
// itself: the cameras of a rig are mostly of one make, and other software takes one lens for all. Empty when
// there is none.
std::string common_lens(const std::vector<std::vector<LensTry>>& cameras) {
  int most = 0;
  for (const auto& rows : cameras) most = std::max(most, simplest(rows)->n_params);
  std::string best;
  std::pair<int, double> best_rank;
  for (const LensTry& first : cameras[0]) {
    std::pair<int, double> rank{first.n_params, 0};
    bool good = first.n_params <= most;
    for (const auto& rows : cameras) {
      const auto t =
          std::find_if(rows.begin(), rows.end(), [&](const LensTry& x) { return x.lens == first.lens; });
      good = good && t != rows.end() && as_good(*t);
      if (good) rank.second += t->held_out_px * t->held_out_px;
    }
    if (!good || (!best.empty() && !(rank < best_rank))) continue;
    best = first.lens;
    best_rank = rank;
  }
  return best;
}

// A row without a trial.
LensTrial left_out(const std::string& camera, const std::string& lens, std::string reason) {
  LensTrial trial;
  trial.row.camera = camera;
  trial.row.lens = lens;
  if (const auto made = make_lens(lens, ImageSize{640, 480}, 500)) trial.row.n_params = n_params(*made);
  trial.row.reason = std::move(reason);
  return trial;
}

Result<std::vector<LensTrial>> try_lenses(const Dataset& data, int cam, const std::vector<std::string>& names,
                                          const RefineOptions& options) {
  if (auto error = none_eligible(data, options, cam, names)) return *error;
  const Dataset mono = mono_data(data, cam).data;
  const LensFitter fitter(mono, options);
  if (!fitter.has_base()) return fitter.error();
  std::vector<LensTrial> trials;
  double least_rms = std::numeric_limits<double>::infinity();
  for (const std::string& name : names) {
    if (const auto why = ineligible(data, options, cam, name)) {
      trials.push_back(left_out(mono.cameras[0].name, name,
                                why->lacks_name ? why->error.where + ": it has no parameter of this name"
                                                : why->error.where + ": " + why->error.message));
      continue;
    }
    trials.push_back(fitter.fit(name));
    if (trials.back().fit) least_rms = std::min(least_rms, trials.back().row.rms_px);
  }
  for (LensTrial& t : trials) {
    if (!t.fit) continue;
    if (t.row.rms_px > kHopelessRatio * least_rms && t.row.rms_px > 1e-6) {
      t.row.reason = fmt::format("its fit has {:.1f} times the least rms", t.row.rms_px / least_rms);
      continue;
    }
    if (auto errors = held_out_errors(*t.fit, options, t.constraints, fitter.cap()))
      t.errors = *std::move(errors);
    else
      t.row.reason = "a part of the views does not determine it";
  }
  compare(trials);
  return trials;
}

std::vector<LensTry> rows_of(const std::vector<LensTrial>& trials) {
  std::vector<LensTry> rows;
  for (const LensTrial& t : trials) rows.push_back(t.row);
  return rows;
}

}  // namespace

Result<detail::ChosenLenses> detail::choose_with_fits(const Dataset& data, const RefineOptions& options,
                                                      const std::vector<std::string>& candidates) {
  ChosenLenses out{{}, std::vector<std::optional<Calibration>>(data.cameras.size())};
  std::vector<std::vector<LensTrial>> trials;
  std::vector<std::vector<LensTry>> rows;
  for (std::size_t cam = 0; cam < data.cameras.size(); ++cam) {
    out.choice.lenses.push_back(options.lenses[options.lenses.size() == 1 ? 0 : cam]);
    if (out.choice.lenses.back() != "auto") continue;
    auto tried = try_lenses(data, static_cast<int>(cam), family(candidates), options);
    if (!tried) return tried.error();
    trials.push_back(*std::move(tried));
    rows.push_back(rows_of(trials.back()));
    if (!simplest(rows.back())) {
      std::string why = "no lens predicts the views that are left out";
      for (const LensTry& row : rows.back()) {
        if (!row.reason.empty()) why += fmt::format("; {}: {}", row.lens, row.reason);
      }
      return Error{ErrorCode::kNotConverged, why, "camera " + data.cameras[cam].name};
    }
  }
  const std::string common = rows.empty() ? "" : common_lens(rows);
  std::size_t n = 0;
  for (std::size_t cam = 0; cam < data.cameras.size(); ++cam) {
    std::string& lens = out.choice.lenses[cam];
    if (lens != "auto") continue;
    lens = common.empty() ? simplest(rows[n])->lens : common;
    for (std::size_t i = 0; i < rows[n].size(); ++i) {
      rows[n][i].chosen = rows[n][i].lens == lens;
      if (rows[n][i].chosen) out.fits[cam] = std::move(trials[n][i].fit);
    }
    out.choice.tries.insert(out.choice.tries.end(), rows[n].begin(), rows[n].end());
    ++n;
  }
  if (auto status = check_choice(data, options, out.choice.lenses); !status) return status.error();
  return out;
}

Result<LensChoice> choose_lenses(const Dataset& data, const RefineOptions& options,
                                 const std::vector<std::string>& candidates) {
  if (auto status = validate(data); !status) return status.error();
  PLUMBLINE_CHECK(options.lenses.size() == 1 || options.lenses.size() == data.cameras.size(),
                  "one lens for all cameras, or one each");
  auto chosen = detail::choose_with_fits(data, options, candidates);
  if (!chosen) return chosen.error();
  return std::move(chosen->choice);
}

}  // namespace plumbline
