// SPDX-License-Identifier: Apache-2.0
#include "plumbline/crosscheck/crosscheck.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "crosscheck/naive_seed.hpp"
#include "crosscheck/referee.hpp"
#include "plumbline/refine/refine.hpp"
#include "plumbline/rig/motion.hpp"

namespace plumbline {
namespace {

using detail::Problem;
using detail::RefereeLens;

bool takes_part(const Calibration& cal, std::size_t v) {
  const View& view = cal.data.views[v];
  return cal.T_rig_board[view.frame] && v < cal.fits.size() && !view.corners.empty() &&
         cal.fits[v].size() == view.corners.size();
}

// Calls body(camera index, p_cam, corner) for each inlier corner.
template <class Body>
void for_each_inlier(const Calibration& cal, Body&& body) {
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    if (!takes_part(cal, v)) continue;
    const View& view = cal.data.views[v];
    const SE3 T = cal.rig.T_cam_rig[view.cam] * *board_pose(cal, view);
    for (std::size_t c = 0; c < view.corners.size(); ++c) {
      if (!cal.fits[v][c].outlier) {
        body(view.cam, T * board_point(cal, view.target, view.corners[c].point), view.corners[c]);
      }
    }
  }
}

// RMS over the inlier corners with any projection per camera, and not what the calibration says of itself. A
// corner that does not project counts with its distance from nowhere: the result is infinite.
double rms_with(const Calibration& cal, const std::vector<Projection>& projections) {
  double sum = 0;
  int n = 0;
  for_each_inlier(cal, [&](int cam, const Vec3& p_cam, const Corner& corner) {
    const auto px = projections[cam](p_cam, nullptr);
    sum += px ? (*px - corner.px).squaredNorm() : INFINITY;
    ++n;
  });
  return n > 0 ? std::sqrt(sum / n) : 0.0;
}

Projection ours(const Camera& camera) {
  return [&camera](const Vec3& p, Mat23* J) { return project(camera.lens, p, J); };
}

double our_rms(const Calibration& cal) {
  std::vector<Projection> projections;
  for (const Camera& camera : cal.rig.cameras) projections.push_back(ours(camera));
  return rms_with(cal, projections);
}

bool used_sigma(const Calibration& cal) {
  const auto option = cal.provenance.options.find("sigma");
  return option != cal.provenance.options.end() && option->second == "used";
}

// One camera with its inlier corners only, its own frame as the rig's.
Calibration alone(const Calibration& cal, int cam) {
  Calibration out;
  out.rig = {{cal.rig.cameras[cam]}, {SE3()}};
  out.data = cal.data;
  out.data.cameras = {cal.data.cameras[cam]};
  out.data.views.clear();
  out.T_rig_board.resize(cal.T_rig_board.size());
  out.T_board0_board = cal.T_board0_board;
  out.bow_m = cal.bow_m;
  out.provenance = cal.provenance;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    View view = cal.data.views[v];
    if (view.cam != cam || !takes_part(cal, v)) continue;
    view.cam = 0;
    view.corners.clear();
    for (std::size_t c = 0; c < cal.fits[v].size(); ++c) {
      if (!cal.fits[v][c].outlier) view.corners.push_back(cal.data.views[v].corners[c]);
    }
    if (view.corners.empty()) continue;
    out.T_rig_board[view.frame] = cal.rig.T_cam_rig[cam] * *cal.T_rig_board[view.frame];
    out.fits.emplace_back(view.corners.size());
    out.data.views.push_back(std::move(view));
  }
  out.view_reason.assign(out.data.views.size(), "");
  return out;
}

// The lone optimum of ours. A rig of one is taken as it is: what it says shall be checked, and not a better
// answer.
Calibration lone_optimum(const Calibration& cal, int cam, std::vector<std::string>& notes) {
  Calibration start = alone(cal, cam);
  if (cal.rig.cameras.size() == 1) return start;
  RefineOptions options;
  options.mark_outliers = false;
  options.use_sigma = used_sigma(cal);
  auto solved = refine(start, options);
  if (solved) return *std::move(solved);
  notes.push_back(fmt::format("camera {} alone: {}; compared at the joint optimum", cal.rig.cameras[cam].name,
                              solved.error().text()));
  return start;
}

// Where in the image of a camera there were corners: within 3 % of the image's diagonal of one.
std::function<bool(const Vec2&)> near_corners(const Calibration& cal, int cam) {
  std::vector<Vec2> px;
  for_each_inlier(cal, [&](int c, const Vec3&, const Corner& corner) {
    if (c == cam) px.push_back(corner.px);
  });
  const ImageSize size = cal.rig.cameras[cam].size;
  const double reach = 0.03 * std::hypot(size.width, size.height);
  return [px = std::move(px), reach](const Vec2& q) {
    for (const Vec2& p : px) {
      if ((p - q).squaredNorm() < reach * reach) return true;
    }
    return false;
  };
}

// The lens that mrcal shall use for a camera of `cal`.
std::optional<RefereeLens> referee_lens(const Calibration& cal, int cam) {
  const Camera& camera = cal.rig.cameras[cam];
  if (auto same = detail::same_lens(camera.lens)) return same;
  std::vector<Vec3> rays;
  for_each_inlier(cal, [&](int c, const Vec3& p_cam, const Corner&) {
    if (c == cam) rays.push_back(p_cam.normalized());
  });
  return detail::fit_splined(camera, rays);
}

// How far the corners are from the camera [m], the median.
double typical_distance(const Calibration& cal, int cam) {
  std::vector<double> distances;
  for_each_inlier(cal, [&](int c, const Vec3& p_cam, const Corner&) {
    if (c == cam) distances.push_back(p_cam.norm());
  });
  std::nth_element(distances.begin(), distances.begin() + distances.size() / 2, distances.end());
  return distances[distances.size() / 2];
}

// A spline that stands for another lens can trade a motion of the camera for control points: the motion is
// taken out first. A splined lens itself says nothing where no corner was.
DiffPx difference(const Calibration& cal, int cam, const RefereeLens& lens, std::vector<std::string>& notes) {
  const Camera& camera = cal.rig.cameras[cam];
  const Projection theirs = detail::projection_of(lens);
  const auto diff = is_sparse(camera.lens)
                        ? compare_projection(camera, theirs, Align::kNone, typical_distance(cal, cam),
                                             near_corners(cal, cam))
                    : detail::same_lens(camera.lens)
                        ? compare_projection(camera, theirs)
                        : compare_projection(camera, theirs, Align::kPose, typical_distance(cal, cam),
                                             near_corners(cal, cam));
  if (diff) return *diff;
  notes.push_back("projections not compared: " + diff.error().text());
  return {};
}

// mrcal's optimum from where the problem stands. A splined lens of ours is mrcal's own, with mrcal's own
// regularisation. Of a splined lens that was fitted to ours only the core is
// free, and the poses: its hundreds of control points would follow the noise, and without mrcal's
// regularisation, which pulls them away from the lens they stand for, those that see no corner would go
// anywhere.
std::optional<double> solve(Problem& problem, const Lens& ours) {
  if (is_sparse(ours))
    return detail::optimise(problem, {.core = false, .distortion = true, .regularise = true});
  const bool splined = problem.model.type == MRCAL_LENSMODEL_SPLINED_STEREOGRAPHIC;
  return detail::optimise(problem, {.core = true, .distortion = !splined});
}

Error refused(const std::string& where) {
  return {ErrorCode::kNotConverged, "mrcal_optimize failed on these corners", where};
}

struct Setup {
  std::optional<Lattice> lattice;
  bool use_sigma = false;
};

// mrcal's optimum from the naive seed.
struct Seeded {
  Problem problem;
  double rms_px = 0;
};
std::optional<Seeded> from_seed(const Calibration& cal, const Setup& setup, std::vector<std::string>& notes) {
  const auto seed = detail::naive_seed(cal);
  if (!seed.note.empty()) notes.push_back(seed.note);
  std::vector<RefereeLens> lenses;
  for (const Camera& camera : seed.calibration.rig.cameras) lenses.push_back(*detail::same_lens(camera.lens));
  Problem problem = detail::make_problem(seed.calibration, *setup.lattice, lenses, setup.use_sigma);
  if (problem.observations.size() !=
      detail::make_problem(cal, *setup.lattice, lenses, setup.use_sigma).observations.size()) {
    notes.push_back("the seed gives some views no pose; mrcal solves the others from it");
  }
  // As mrcal's own calibration tool goes: poses first, then the core, then everything.
  if (!detail::optimise(problem, {.core = false, .distortion = false, .max_rounds = 1})) return std::nullopt;
  if (!detail::optimise(problem, {.core = true, .distortion = false, .max_rounds = 1})) return std::nullopt;
  const auto rms = solve(problem, seed.calibration.rig.cameras[0].lens);
  if (!rms) return std::nullopt;
  return Seeded{std::move(problem), *rms};
}

Result<CameraCrosscheck> check_camera(const Calibration& cal, int cam, const Setup& setup,
                                      std::vector<std::string>& notes) {
  const Calibration lone = lone_optimum(cal, cam, notes);
  const Camera& camera = lone.rig.cameras[0];
  CameraCrosscheck out;
  out.name = camera.name;
  out.lens = lens_name(camera.lens);
  out.rms_px = our_rms(lone);
  out.parameters.assign(params(camera.lens).begin(), params(camera.lens).end());
  auto lens = referee_lens(lone, 0);
  if (!lens) {
    notes.push_back(fmt::format("camera {}: mrcal has no lens to compare with {}", camera.name, out.lens));
    return out;
  }
  out.referee_lens = lens->name;
  if (!detail::same_lens(camera.lens)) {
    const DiffPx fit = difference(lone, 0, *lens, notes);
    notes.push_back(
        fmt::format("camera {}: mrcal has no lens {}; {} fitted to it projects within {:.2g} px (rms {:.2g}) "
                    "near the corners; mrcal then solves core and poses, its {} control values held",
                    camera.name, out.lens, lens->name, fit.max, fit.rms, lens->parameters.size() - 4));
  }
  if (setup.lattice) {
    Problem problem = detail::make_problem(lone, *setup.lattice, {*lens}, setup.use_sigma);
    const auto rms = solve(problem, camera.lens);
    if (!rms) return refused("camera " + camera.name);
    out.referee_rms_px = *rms;
    lens->parameters = problem.intrinsics[0];
    // An optimum found without ours says more than one found from it; taken when it is the same one.
    if (detail::same_lens(camera.lens) && !is_sparse(camera.lens)) {
      std::vector<std::string> of_the_seed;  // said for all cameras together
      const auto seeded = from_seed(lone, setup, of_the_seed);
      if (seeded && of_the_seed.empty() && seeded->rms_px <= *rms * (1 + 1e-8)) {
        out.referee_rms_px = seeded->rms_px;
        lens->parameters = seeded->problem.intrinsics[0];
      }
    }
  } else {
    out.referee_rms_px = rms_with(lone, {detail::projection_of(*lens)});
  }
  out.referee_parameters = lens->parameters;
  out.diff_px = difference(lone, 0, *lens, notes);
  return out;
}

// The lenses of all cameras of one and the same model of mrcal, or nothing: mrcal takes one model per
// problem.
std::optional<std::vector<RefereeLens>> common_lenses(const Calibration& cal) {
  const std::string spec = lens_spec(cal.rig.cameras[0].lens);
  std::vector<RefereeLens> lenses;
  for (std::size_t cam = 0; cam < cal.rig.cameras.size(); ++cam) {
    if (lens_spec(cal.rig.cameras[cam].lens) != spec) return std::nullopt;
    if (auto same = detail::same_lens(cal.rig.cameras[cam].lens)) {
      lenses.push_back(*std::move(same));
      continue;
    }
    // One configuration for all: around the rays of all cameras.
    std::vector<Vec3> rays;
    for_each_inlier(cal, [&](int, const Vec3& p_cam, const Corner&) { rays.push_back(p_cam.normalized()); });
    auto fitted = detail::fit_splined(cal.rig.cameras[cam], rays);
    if (!fitted) return std::nullopt;
    lenses.push_back(*std::move(fitted));
  }
  return lenses;
}

// The joint solve, or what stands in for it.
Status check_joint(const Calibration& cal, const Setup& setup, Crosscheck& out) {
  out.rms_px = our_rms(cal);
  const auto lenses = common_lenses(cal);
  if (!lenses || !setup.lattice) {
    std::vector<RefereeLens> each;
    std::vector<Projection> projections;
    each.reserve(cal.rig.cameras.size());
    for (std::size_t cam = 0; cam < cal.rig.cameras.size(); ++cam) {
      auto lens = referee_lens(cal, static_cast<int>(cam));
      if (!lens) return {};
      each.push_back(*std::move(lens));
      projections.push_back(detail::projection_of(each.back()));
    }
    out.referee_rms_px = out.referee_rms_from_seed_px = rms_with(cal, projections);
    if (setup.lattice) {
      out.notes.push_back(
          "mrcal takes one lens model per problem, and this rig has several: its joint RMS is that of its "
          "projections at our optimum, not of a solve");
    }
    return {};
  }
  Problem problem = detail::make_problem(cal, *setup.lattice, *lenses, setup.use_sigma);
  const auto rms = solve(problem, cal.rig.cameras[0].lens);
  if (!rms) return refused("all cameras");
  out.referee_rms_px = *rms;
  out.bow_m = bow_of(cal, 0);
  out.referee_bow_m = problem.warp_m;
  for (std::size_t cam = 0; cam < cal.rig.cameras.size(); ++cam) {
    RefereeLens lens = (*lenses)[cam];
    lens.parameters = problem.intrinsics[cam];
    out.cameras[cam].joint_diff_px = difference(cal, static_cast<int>(cam), lens, out.notes);
  }
  if (is_sparse(cal.rig.cameras[0].lens) || !detail::same_lens(cal.rig.cameras[0].lens)) {
    out.referee_rms_from_seed_px = out.referee_rms_px;
    out.notes.push_back(
        "no start from a seed: the splined lens starts from ours, or from the one fitted to ours");
    return {};
  }
  const auto seeded = from_seed(cal, setup, out.notes);
  if (!seeded) {
    out.notes.push_back("mrcal finds no optimum from the seed");
    out.referee_rms_from_seed_px = INFINITY;
    return {};
  }
  out.referee_rms_from_seed_px = seeded->rms_px;
  if (std::abs(seeded->rms_px - *rms) > 1e-4 * (1 + *rms)) {
    out.notes.push_back(
        fmt::format("mrcal reaches {:.6f} px from the seed and {:.6f} px from our optimum: the problem has "
                    "more than one optimum, or a valley that is nearly flat",
                    seeded->rms_px, *rms));
  }
  return {};
}

void note_options(const Calibration& cal, std::vector<std::string>& notes) {
  const auto& options = cal.provenance.options;
  if (const auto fixed = options.find("fixed"); fixed != options.end() && !fixed->second.empty()) {
    notes.push_back("held in the calibration and free for mrcal: " + fixed->second);
  }
  if (const auto held = options.find("held_monotonic"); held != options.end()) {
    notes.push_back(
        "the lens of " + held->second +
        " was held to a map that rises over the picture, mrcal's is free: they differ beyond the corners");
  }
  if (const auto loss = options.find("loss"); loss != options.end() && loss->second != "squared") {
    notes.push_back("the calibration used the loss '" + loss->second +
                    "', mrcal squares: the optima differ by that");
  }
}

}  // namespace

Result<Crosscheck> crosscheck_mrcal(const Calibration& calibration) {
  PLUMBLINE_CHECK(calibration.fits.size() == calibration.data.views.size() &&
                      calibration.T_rig_board.size() == calibration.data.frames.size() &&
                      calibration.T_board0_board.size() == calibration.data.targets.size() &&
                      !calibration.data.targets.empty() &&
                      calibration.rig.cameras.size() == calibration.rig.T_cam_rig.size() &&
                      calibration.rig.cameras.size() == calibration.data.cameras.size(),
                  "rig, data, poses and fits of a calibration belong together");
  if (has_clocks(calibration))
    return Error{ErrorCode::kUnsupported,
                 "mrcal knows neither line delays nor time offsets, so it cannot referee this calibration; "
                 "calibrate without --refine line-delay,time-offset to compare the rest",
                 ""};
  const int n_cams = static_cast<int>(calibration.rig.cameras.size());
  std::vector<int> corners(static_cast<std::size_t>(n_cams), 0);
  for_each_inlier(calibration, [&](int cam, const Vec3&, const Corner&) { ++corners[cam]; });
  for (int cam = 0; cam < n_cams; ++cam) {
    if (corners[cam] > 0) continue;
    return Error{ErrorCode::kDegenerate, "no corner of this camera takes part in the calibration",
                 "camera " + calibration.rig.cameras[cam].name};
  }
  Crosscheck out;
  const std::vector<Target>& targets = calibration.data.targets;
  Setup setup{targets.size() == 1 ? detail::referee_lattice(targets[0]) : std::nullopt,
              used_sigma(calibration)};
  note_options(calibration, out.notes);
  if (targets.size() > 1) {
    out.notes.push_back(fmt::format(
        "mrcal solves for one board, and here are {}: its figures are those of its projection at our "
        "optimum, not of a solve",
        targets.size()));
  } else if (!setup.lattice) {
    out.notes.push_back(
        fmt::format("the points of target {} are not one uniform grid, which is what mrcal solves: its "
                    "figures are those of its projection at our optimum, not of a solve",
                    targets[0].name));
  }
  for (int cam = 0; cam < n_cams; ++cam) {
    auto camera = check_camera(calibration, cam, setup, out.notes);
    if (!camera) return camera.error();
    out.cameras.push_back(*std::move(camera));
  }
  if (auto status = check_joint(calibration, setup, out); !status) return status.error();
  return out;
}

}  // namespace plumbline
