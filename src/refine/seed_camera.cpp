// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "plumbline/core/parallel.hpp"
#include "plumbline/linear/camera_matrix.hpp"
#include "plumbline/linear/homography.hpp"
#include "plumbline/linear/pose.hpp"
#include "plumbline/linear/zhang.hpp"
#include "refine/seed.hpp"

namespace plumbline::detail {

MonoData mono_data(const Dataset& data, int cam) {
  MonoData mono;
  mono.data = {data.target, {data.cameras[cam]}, data.frames, {}, data.detector};
  for (std::size_t v = 0; v < data.views.size(); ++v) {
    if (data.views[v].cam != cam) continue;
    mono.data.views.push_back(data.views[v]);
    mono.data.views.back().cam = 0;
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
  std::vector<double> errors;
  for (const Corner& c : view.corners) {
    const auto px = project(lens, T_cam_board * target.points[c.point]);
    errors.push_back(px ? std::min((*px - c.px).norm(), lost) : lost);
  }
  return errors;
}

double rms(const std::vector<double>& errors) {
  double sum = 0;
  for (double e : errors) sum += e * e;
  return errors.empty() ? 0 : std::sqrt(sum / static_cast<double>(errors.size()));
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

std::optional<SE3> find_pose(const Lens& lens, const Target& target, const View& view) {
  constexpr double kLost = 1e6;
  std::vector<bool> use(view.corners.size(), true);
  const auto first = pose_of_corners(lens, target, view, use);
  if (!first) return std::nullopt;
  const std::vector<double> errors = errors_px(lens, *first, target, view, kLost);
  // One corner far off bends a least-squares pose: leave out what is beyond six times the median, and keep
  // the new pose when most corners agree better with it.
  const double typical = median(errors), bound = 6 * typical + 1e-6;
  if (*std::max_element(errors.begin(), errors.end()) <= bound) return first;
  for (std::size_t i = 0; i < use.size(); ++i) use[i] = errors[i] <= bound;
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

namespace {

constexpr int kSubsetViews = 16;  // enough to tell focal lengths apart, few enough to try several
constexpr int kCandidates = 5;

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
  Dataset subset{mono.target, mono.cameras, mono.frames, {}, mono.detector};
  for (int v : views) subset.views.push_back(mono.views[v]);
  return subset;
}

// Which parameters are free while the lens is still far off: focal lengths and the first radial term, then
// all but the high orders (which would otherwise fit the error of the start and fold the image back over
// itself), then all.
bool free_at_stage(std::string_view name, int stage) {
  if (stage >= 2) return true;
  if (stage == 0) return name == "fx" || name == "fy" || name == "k1";
  return name != "k3" && name != "k4" && name != "k5" && name != "k6" && name.front() != 's';
}

SolveSpec seed_spec(const Calibration& cal, int stage, int max_iterations, const RefineOptions& options,
                    const std::vector<bool>& held) {
  SolveSpec spec{.loss = Loss::kCauchy,
                 .loss_scale = robust_scale_px(cal),
                 .max_iterations = max_iterations,
                 .tight = false,
                 .held = held};
  spec.use_sigma = false;  // seeds compare pixels
  (void)options;
  const auto names = param_names(cal.rig.cameras[0].lens);
  for (std::size_t i = 0; i < names.size(); ++i)
    spec.held[i] = spec.held[i] || !free_at_stage(names[i], stage);
  return spec;
}

// Gives each view the pose that fits better: the one it has or a fresh one for the present lens. Views
// without any leave.
void pose_views(Calibration& cal) {
  const Lens& lens = cal.rig.cameras[0].lens;
  const double lost = 0.05 * diagonal_px(cal.rig.cameras[0].size);
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    const View& view = cal.data.views[v];
    if (view.corners.size() < 4) continue;
    std::optional<SE3>& pose = cal.T_rig_board[view.frame];
    const auto fresh = find_pose(lens, cal.data.target, view);
    if (fresh && (!pose || rms(errors_px(lens, *fresh, cal.data.target, view, lost)) <
                               rms(errors_px(lens, *pose, cal.data.target, view, lost)))) {
      pose = fresh;
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
    const double e = pose ? rms(errors_px(cal.rig.cameras[0].lens, *pose, cal.data.target, view, cap)) : cap;
    sum += e * e;
    ++n;
  }
  return n > 0 ? std::sqrt(sum / n) : cap;
}

struct Candidate {
  Lens lens;
  double score = 0;
};

std::optional<Lens> lens_with(const std::string& name, ImageSize size, double fx, double fy, double cx,
                              double cy) {
  auto lens = make_lens(name, size, fx);
  if (!lens) return std::nullopt;
  const auto k = params(*lens);
  k[1] = fy;
  k[2] = cx;
  k[3] = cy;
  return *lens;
}

// K of a closed form becomes a candidate when it is a camera that could exist.
void add_closed_form(std::vector<Lens>& list, const Mat3& K, const std::string& name, ImageSize size,
                     bool centre_held) {
  const double fx = K(0, 0), fy = K(1, 1), w = size.width, h = size.height;
  if (!(fx > 0.02 * w) || !(fx < 100 * w) || !(fy > 0.5 * fx) || !(fy < 2 * fx)) return;
  const bool centre_ok = !centre_held && K(0, 2) > 0 && K(0, 2) < w && K(1, 2) > 0 && K(1, 2) < h;
  const double cx = centre_ok ? K(0, 2) : 0.5 * (w - 1), cy = centre_ok ? K(1, 2) : 0.5 * (h - 1);
  if (auto lens = lens_with(name, size, fx, fy, cx, cy)) list.push_back(*lens);
}

void add_zhang(std::vector<Lens>& list, const Dataset& subset, const std::string& name, bool centre_held) {
  const ImageSize size = subset.cameras[0].size;
  std::vector<Mat3> H_px_board;
  for (const View& view : subset.views) {
    std::vector<Vec2> board, px;
    for (const Corner& c : view.corners) {
      board.push_back(subset.target.points[c.point].head<2>());
      px.push_back(c.px);
    }
    if (board.size() < 4) continue;
    if (const auto H = homography(board, px)) H_px_board.push_back(*H);
  }
  if (H_px_board.size() >= 2) {
    if (const auto K = zhang_k(H_px_board, size)) add_closed_form(list, *K, name, size, centre_held);
  }
  if (!H_px_board.empty()) {
    if (const auto f = zhang_focal(H_px_board, size)) {
      const Mat3 K{{*f, 0, -1}, {0, *f, -1}, {0, 0, 1}};
      add_closed_form(list, K, name, size, centre_held);
    }
  }
}

void add_dlt(std::vector<Lens>& list, const Dataset& subset, const std::string& name, bool centre_held) {
  for (const View& view : subset.views) {
    std::vector<Vec3> p_world;
    std::vector<Vec2> px;
    for (const Corner& c : view.corners) {
      p_world.push_back(subset.target.points[c.point]);
      px.push_back(c.px);
    }
    if (p_world.size() < 6) continue;
    const auto P = camera_matrix(p_world, px);
    if (!P) continue;
    if (const auto parts = decompose_camera_matrix(*P)) {
      add_closed_form(list, parts->K, name, subset.cameras[0].size, centre_held);
    }
  }
}

// A geometric grid of focal lengths without distortion: from a lens that sees 180 degrees in a tenth of the
// image's width to one that sees 7 degrees. Fisheyes and pinholes alike; the lens' own projection decides
// which fits.
void add_scan(std::vector<Lens>& list, const std::string& name, ImageSize size) {
  const double width = std::max(size.width, size.height);
  for (double ratio = 0.15; ratio < 8.5; ratio *= 1.2) {
    if (auto lens = make_lens(name, size, ratio * width)) list.push_back(*lens);
  }
}

Calibration start_from(const Dataset& subset, const Lens& lens) {
  Calibration cal = empty_calibration(subset, {lens});
  pose_views(cal);
  return cal;
}

// Refines a candidate on the subset, in stages; false when the solver finds nothing finite.
bool polish(Calibration& cal, const RefineOptions& options, const std::vector<bool>& held) {
  for (int stage = 0; stage < 3; ++stage) {
    Calibration trial = cal;
    if (!solve(trial, seed_spec(cal, stage, stage < 2 ? 20 : 40, options, held)).usable) {
      if (stage == 0) return false;
      break;
    }
    cal = std::move(trial);
    pose_views(cal);
  }
  return true;
}

// The best few focal lengths that are not neighbours on the grid: the bottoms of different valleys.
std::vector<Lens> best_candidates(std::vector<Candidate> all) {
  std::stable_sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.score < b.score; });
  std::vector<Lens> chosen;
  for (const Candidate& c : all) {
    const double f = params(c.lens)[0];
    const bool is_new = std::none_of(chosen.begin(), chosen.end(), [&](const Lens& other) {
      return std::abs(std::log(f / params(other)[0])) < std::log(1.15);
    });
    if (is_new) chosen.push_back(c.lens);
    if (chosen.size() == kCandidates) break;
  }
  return chosen;
}

bool points_lie_at_z0(const Target& target) {
  return std::all_of(target.points.begin(), target.points.end(), [](const Vec3& p) { return p.z() == 0.0; });
}

}  // namespace

Result<Calibration> seed_camera(const Dataset& mono, const std::string& lens_name,
                                const RefineOptions& options, const std::vector<bool>& held) {
  const ImageSize size = mono.cameras[0].size;
  const Dataset subset = with_views(mono, spread_subset(mono, kSubsetViews));
  const bool centre_held = held[2] || held[3];
  std::vector<Lens> starts;
  const bool dlt = options.start == Start::kDlt || (options.start == Start::kAuto && !mono.target.is_planar);
  if (dlt) add_dlt(starts, subset, lens_name, centre_held);
  if (points_lie_at_z0(mono.target) && !dlt) add_zhang(starts, subset, lens_name, centre_held);
  add_scan(starts, lens_name, size);

  std::vector<Candidate> candidates(starts.size());
  parallel_for(static_cast<int>(starts.size()), options.n_threads, [&](int i) {
    candidates[i] = {starts[i], score_px(start_from(subset, starts[i]))};
  });
  const std::vector<Lens> chosen = best_candidates(std::move(candidates));
  std::vector<std::optional<Calibration>> polished(chosen.size());
  parallel_for(static_cast<int>(chosen.size()), options.n_threads, [&](int i) {
    Calibration cal = start_from(subset, chosen[i]);
    if (polish(cal, options, held)) polished[i] = std::move(cal);
  });
  const Calibration* best = nullptr;
  double best_score = 0;
  for (const auto& cal : polished) {
    if (!cal) continue;
    const double score = score_px(*cal);
    if (best && !(score < best_score)) continue;
    best = &*cal;
    best_score = score;
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

  // All views, from the lens that the subset gave.
  Calibration cal = empty_calibration(mono, {best->rig.cameras[0].lens});
  pose_views(cal);
  for (int round = 0; round < 2; ++round) {
    Calibration trial = cal;
    if (!solve(trial, seed_spec(cal, 2, 60, options, held)).usable) break;
    cal = std::move(trial);
    pose_views(cal);
  }
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    if (cal.fits[v].empty() && !cal.data.views[v].corners.empty()) {
      cal.view_reason[v] =
          fmt::format("no pose of the board fits its {} corners", cal.data.views[v].corners.size());
    }
  }
  return cal;
}

}  // namespace plumbline::detail
