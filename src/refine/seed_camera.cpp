// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "plumbline/core/parallel.hpp"
#include "refine/seed.hpp"

namespace plumbline::detail {

namespace {

constexpr int kSubsetViews = 16;  // enough to tell focal lengths apart, few enough to try several
constexpr int kCandidates = 5;
// Of a view, for its pose under a lens that is a guess anyway; first few of few views for all starts, then
// more for those that came out best.
constexpr int kPosedCorners = 36, kFirstCorners = 16, kFirstViews = 6, kSecondLook = 8;

// Views spread evenly over those that have enough corners.
std::vector<int> spread_subset(const Dataset& mono, int n_wanted) {
  std::vector<int> usable, chosen;
  for (std::size_t v = 0; v < mono.views.size(); ++v) {
    if (mono.views[v].corners.size() >= 4) usable.push_back(static_cast<int>(v));
  }
  const int n = static_cast<int>(usable.size()), wanted = std::min(n, n_wanted);
  for (int i = 0; i < wanted; ++i) chosen.push_back(usable[static_cast<std::size_t>(i) * n / wanted]);
  return chosen;
}

Dataset with_views(const Dataset& mono, const std::vector<int>& views) {
  Dataset subset{mono.targets, mono.cameras, mono.frames, {}, mono.detector};
  for (int v : views) subset.views.push_back(mono.views[v]);
  return subset;
}

// Which parameters are free while the lens is still far off: focal lengths and the first radial term (a shape
// of the sphere is one too), then
// all but the high orders (which would otherwise fit the error of the start and fold the image back over
// itself), then all.
bool free_at_stage(std::string_view name, int stage) {
  if (stage >= 2) return true;
  if (stage == 0)
    return name == "fx" || name == "fy" || name == "k1" || name == "alpha" || name == "w" || name == "lambda";
  return name != "k3" && name != "k4" && name != "k5" && name != "k6" && name.front() != 's';
}

SolveSpec seed_spec(const Calibration& cal, int stage, int max_iterations, const Constraints& constraints) {
  const double scale = robust_scale_px(cal);
  SolveSpec spec = with_constraints({.loss = Loss::kCauchy,
                                     .loss_scale = scale,
                                     .use_sigma = false,  // seeds compare pixels
                                     .max_iterations = max_iterations,
                                     .tight = false,
                                     .prior_weight = scale / 3},
                                    constraints);
  const auto names = param_names(cal.rig.cameras[0].lens);
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (free_at_stage(names[i], stage)) continue;
    for (std::size_t j = 0; j < names.size(); ++j) {
      if (spec.tied_to[j] == spec.tied_to[i]) spec.held[j] = true;
    }
  }
  return spec;
}

struct Candidate {
  Calibration calibration;
  double score = 0;
  const Lens& lens() const { return calibration.rig.cameras[0].lens; }
};

Calibration start_from(const Dataset& subset, const Lens& lens, int most_corners = kPosedCorners) {
  Calibration cal = empty_calibration(subset, {lens});
  pose_views(cal, Repose::kAll, most_corners);
  return cal;
}

// Refines a candidate on the subset, in stages; false when the solver finds nothing finite.
bool polish(Calibration& cal, int first_stage, const Constraints& constraints) {
  for (int stage = first_stage; stage < 3; ++stage) {
    Calibration trial = cal;
    if (!solve(trial, seed_spec(cal, stage, stage < 2 ? 20 : 40, constraints)).usable) {
      if (stage == first_stage) return false;
      break;
    }
    cal = std::move(trial);
    pose_views(cal, Repose::kPoor);
  }
  return true;
}

std::vector<Candidate> scored(const Dataset& subset, const std::vector<Lens>& lenses, int most_corners,
                              int n_threads) {
  std::vector<Candidate> candidates(lenses.size());
  parallel_for(static_cast<int>(lenses.size()), n_threads, [&](int i) {
    candidates[i].calibration = start_from(subset, lenses[i], most_corners);
    candidates[i].score = score_px(candidates[i].calibration);
  });
  return candidates;
}

// The best few focal lengths that are not neighbours on the grid: the bottoms of different valleys.
std::vector<Candidate> best_candidates(std::vector<Candidate> all, std::size_t most) {
  std::stable_sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.score < b.score; });
  std::vector<Candidate> chosen;
  for (Candidate& c : all) {
    const double f = params(c.lens())[0];
    const bool is_new = std::none_of(chosen.begin(), chosen.end(), [&](const Candidate& other) {
      return std::abs(std::log(f / params(other.lens())[0])) < std::log(1.15);
    });
    if (is_new) chosen.push_back(std::move(c));
    if (chosen.size() == most) break;
  }
  return chosen;
}

// The best calibration of the subset over all starts, and its score.
std::optional<Calibration> best_on_subset(const Dataset& subset, const std::string& lens_name,
                                          const RefineOptions& options, const Constraints& constraints) {
  std::vector<Lens> starts =
      starting_lenses(subset, lens_name, options.start, constraints.held[2] || constraints.held[3]);
  for (Lens& lens : starts) apply(lens, constraints);
  const Dataset few = with_views(subset, spread_subset(subset, kFirstViews));
  std::vector<Lens> better;
  for (const Candidate& c :
       best_candidates(scored(few, starts, kFirstCorners, options.n_threads), kSecondLook))
    better.push_back(c.lens());
  std::vector<Candidate> chosen =
      best_candidates(scored(subset, better, kPosedCorners, options.n_threads), kCandidates);
  std::vector<std::optional<Calibration>> polished(chosen.size());
  parallel_for(static_cast<int>(chosen.size()), options.n_threads, [&](int i) {
    Calibration& cal = chosen[i].calibration;
    if (polish(cal, 0, constraints)) polished[i] = std::move(cal);
  });
  std::optional<Calibration> best;
  for (auto& cal : polished) {
    if (cal && (!best || score_px(*cal) < score_px(*best))) best = std::move(cal);
  }
  return best;
}

// Some rounds of a solve of everything; corners that left the domain come back after each.
Calibration settle(Calibration cal, int n_rounds, const Constraints& constraints) {
  for (int round = 0; round < n_rounds; ++round) {
    Calibration trial = cal;
    if (!solve(trial, seed_spec(cal, 2, 60, constraints)).usable) break;
    cal = std::move(trial);
    pose_views(cal, Repose::kPoor);
  }
  return cal;
}

// All views, from the lens that the subset gave.
Calibration on_all_views(const Dataset& mono, const Lens& lens, const Constraints& constraints) {
  return settle(start_from(mono, lens), 2, constraints);
}

// Angles from the optical axis of the corners that take part [rad].
std::vector<double> angles_off_axis(const Calibration& cal) {
  std::vector<double> angles;
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    if (!takes_part(cal, v)) continue;
    const View& view = cal.data.views[v];
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      if (cal.fits[v][i].outlier) continue;
      const Vec3 p_cam = *cal.T_rig_board[view.frame] * cal.data.targets[0].points[view.corners[i].point];
      angles.push_back(std::atan2(p_cam.head<2>().norm(), p_cam.z()));
    }
  }
  return angles;
}

// A wide image and a perspective lens: on the way from no distortion to much, the polynomial folds the rim of
// the image back, the domain stops the solver there, and a wrong valley is left. A fisheye lens has no such
// wall. So take the fisheye calibration of all views, convert its lens, keep its board poses for a first
// solve of the lens alone, and go on from there.
std::optional<Calibration> by_way_of_fisheye(const Calibration& fisheye, const std::string& lens_name,
                                             const Constraints& constraints) {
  Calibration cal = fisheye;
  const Camera& camera = fisheye.rig.cameras[0];
  auto lens =
      perspective_like(camera.lens, lens_name, camera.size, angles_off_axis(fisheye), constraints.held);
  if (!lens) return std::nullopt;
  apply(*lens, constraints);
  cal.rig.cameras[0].lens = *lens;
  bring_back(cal);
  Calibration trial = cal;
  SolveSpec lens_only = seed_spec(cal, 2, 50, constraints);
  lens_only.hold_boards = true;
  if (solve(trial, lens_only).usable && score_px(trial) < score_px(cal)) cal = std::move(trial);
  pose_views(cal);
  return settle(std::move(cal), 3, constraints);
}

// Whether the seed may sit in a wrong valley: it does not fit well, has corners outside its domain, or sees
// more than 40 degrees off its axis, where a wrong valley can fit to half a pixel.
bool is_doubtful(const Calibration& cal) {
  constexpr double kGoodPx = 1.0, kWideDeg = 40;
  if (score_px(cal) > kGoodPx) return true;
  const double wide = std::tan(kWideDeg * std::numbers::pi / 180);
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    if (!takes_part(cal, v)) continue;
    const View& view = cal.data.views[v];
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      const Vec3 p_cam = *cal.T_rig_board[view.frame] * cal.data.targets[0].points[view.corners[i].point];
      if (cal.fits[v][i].outlier || p_cam.head<2>().norm() > wide * p_cam.z()) return true;
    }
  }
  return false;
}

// The best calibration of the subset, carried on to all views.
std::optional<Calibration> calibrate_on(const Dataset& mono, const Dataset& subset,
                                        const std::string& lens_name, const RefineOptions& options,
                                        const Constraints& constraints) {
  const auto on_subset = best_on_subset(subset, lens_name, options, constraints);
  if (!on_subset) return std::nullopt;
  return on_all_views(mono, on_subset->rig.cameras[0].lens, constraints);
}

// Both lenses were fitted to the same corners, so that a large difference between them is the lens' fault and
// not that of the board or the corner finder.
void warn_of_lean_lens(Calibration& cal, const Calibration& fisheye) {
  constexpr double kTimesWorse = 3, kLeastPx = 1;
  const double lean_px = score_px(cal), fisheye_px = score_px(fisheye);
  if (!(lean_px > kLeastPx) || !(lean_px > kTimesWorse * fisheye_px)) return;
  const Camera& camera = cal.rig.cameras[0];
  cal.stats.weak.push_back(
      {camera.name + " fx", 0,
       fmt::format(
           "lens {} cannot describe camera {}: over all its corners it leaves {:.2g} px where lens kb4 "
           "leaves {:.2g} px; choose kb4, or a perspective lens with more terms",
           lens_name(camera.lens), camera.name, lean_px, fisheye_px)});
}

}  // namespace

Constraints of_matrix_alone(const Constraints& constraints, int n) {
  Constraints c = slice(constraints, 0, 4);
  c.held.resize(static_cast<std::size_t>(n), false);
  for (int i = 4; i < n; ++i) c.tied_to.push_back(i);
  return c;
}

Result<Calibration> seed_camera(const Dataset& mono, const std::string& lens_name,
                                const RefineOptions& options, const Constraints& constraints) {
  const ImageSize size = mono.cameras[0].size;
  const auto plain = make_lens(lens_name, size, size.width);
  if (plain && is_sparse(*plain)) return seed_sparse(mono, lens_name, options, constraints);
  const Dataset subset = with_views(mono, spread_subset(mono, kSubsetViews));
  std::optional<Calibration> best = calibrate_on(mono, subset, lens_name, options, constraints);
  if (plain && is_central_perspective(*plain) && (!best || is_doubtful(*best))) {
    if (const auto fisheye = calibrate_on(mono, subset, "kb4", options, of_matrix_alone(constraints, 8))) {
      auto cal = by_way_of_fisheye(*fisheye, lens_name, constraints);
      if (cal && (!best || score_px(*cal) < score_px(*best))) best = std::move(cal);
      if (best) warn_of_lean_lens(*best, *fisheye);
    }
  }
  if (!best) {
    return Error{
        ErrorCode::kNotConverged,
        fmt::format(
            "no focal length between {:.0f} and {:.0f} px leads to a finite optimum of lens {}; check the "
            "target's size and the lens",
            0.15 * size.width, 8.0 * size.width, lens_name),
        "camera " + mono.cameras[0].name};
  }
  for (std::size_t v = 0; v < best->data.views.size(); ++v) {
    if (best->fits[v].empty() && !best->data.views[v].corners.empty()) {
      best->view_reason[v] =
          fmt::format("no pose of the board fits its {} corners", best->data.views[v].corners.size());
    }
  }
  return *std::move(best);
}

}  // namespace plumbline::detail
