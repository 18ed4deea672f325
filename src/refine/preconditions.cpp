// SPDX-License-Identifier: Apache-2.0
#include "refine/preconditions.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "refine/block_solve.hpp"
#include "refine/rig_graph.hpp"
#include "refine/solve.hpp"

namespace plumbline::detail {
namespace {

constexpr std::size_t kLeastCorners = 4;  // a pose has six unknowns, a planar one needs four points

// A view of a flat board says two things of fx, fy, cx and cy (Zhang 2000), so fewer views serve where some
// of them are known.
int needed_flat_views(const Calibration& cal, std::size_t cam, const Constraints& c) {
  const int first = offsets_of(cal).lens[cam];
  int n_free = 0;
  for (int i = first; i < first + 4; ++i) {
    const bool has_prior =
        std::any_of(c.priors.begin(), c.priors.end(), [&](const PriorTerm& p) { return p.index == i; });
    n_free += !c.held[i] && c.tied_to[i] == i && !has_prior;
  }
  return n_free == 4 ? 3 : std::max(1, (n_free + 1) / 2);
}

// The first of the texts in `fixed` that holds this parameter.
std::string holder_of(const Calibration& cal, const RefineOptions& options, int index) {
  for (const std::string& text : options.fixed) {
    RefineOptions alone;
    alone.fixed = {text};
    const auto c = constraints_of(cal, alone);
    if (c && c->held[static_cast<std::size_t>(index)]) return text;
  }
  return shared_parameter_names(cal)[static_cast<std::size_t>(index)];
}

}  // namespace

Status check_options(const RefineOptions& options) {
  const auto bad = [](std::string message) {
    return Error{ErrorCode::kInvalidData, std::move(message), "options"};
  };
  if (!(options.loss_scale_px > 0))
    return bad(fmt::format("loss scale {} px is not positive", options.loss_scale_px));
  if (!(options.outlier_sigma > 0))
    return bad(fmt::format("outlier sigma {} is not positive", options.outlier_sigma));
  if (options.max_iterations < 1) return bad(fmt::format("{} iterations", options.max_iterations));
  return {};
}

void refuse_small_views(Calibration& cal) {
  const std::size_t least = kLeastCorners;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    const View& view = cal.data.views[v];
    if (view.corners.empty()) {
      cal.fits[v].clear();
      cal.view_reason[v] = view.reason.empty() ? "no corners" : view.reason;
    } else if (view.corners.size() < least) {
      cal.fits[v].clear();
      cal.view_reason[v] = fmt::format("{} corners, at least {} are needed", view.corners.size(), least);
    } else if (!cal.T_rig_board[view.frame]) {
      cal.fits[v].clear();
      if (cal.view_reason[v].empty()) cal.view_reason[v] = "its frame has no board pose";
    }
  }
}

std::optional<Error> unprojectable(const Calibration& cal) {
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    if (!takes_part(cal, v)) continue;
    const View& view = cal.data.views[v];
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      if (!cal.fits[v][i].outlier) continue;
      const Camera& camera = cal.rig.cameras[view.cam];
      return Error{
          ErrorCode::kNotConverged,
          fmt::format(
              "point {} lies outside the domain of lens {} at the start; leave outlier marking on, or "
              "choose a lens for a wider view",
              view.corners[i].point, lens_name(camera.lens)),
          fmt::format("camera {}, view {}", camera.name, view.image)};
    }
  }
  return std::nullopt;
}

Status enough_views(const Calibration& cal, const Constraints& constraints) {
  for (std::size_t cam = 0; cam < cal.rig.cameras.size(); ++cam) {
    const bool some_planar = std::any_of(cal.data.targets.begin(), cal.data.targets.end(),
                                         [](const Target& target) { return target.is_planar; });
    int n = 0, needed = some_planar ? needed_flat_views(cal, cam, constraints) : 1;
    for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
      const View& view = cal.data.views[v];
      if (view.cam != static_cast<int>(cam) || view.corners.size() < kLeastCorners ||
          !cal.view_reason[v].empty())
        continue;
      ++n;
      if (!cal.data.targets[view.target].is_planar) needed = 1;
    }
    if (n >= needed) continue;
    return Error{
        ErrorCode::kDegenerate,
        fmt::format(
            "{} usable view{} of the board, at least {} are needed; add images that show the board tilted "
            "in several directions",
            n, n == 1 ? "" : "s", needed),
        "camera " + cal.rig.cameras[cam].name};
  }
  return {};
}

Status still_together(const Calibration& cal, const Constraints& constraints) {
  if (auto status = enough_views(cal, constraints); !status) return status;
  std::vector<Sight> sights;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    const View& view = cal.data.views[v];
    if (takes_part(cal, v)) sights.push_back({view.cam, view.frame, view.target});
  }
  const int n_cams = static_cast<int>(cal.rig.cameras.size());
  const RigGroups groups = rig_groups(n_cams, static_cast<int>(cal.data.targets.size()), sights, true);
  const Offsets offsets = offsets_of(cal);
  for (int cam = 1; cam < n_cams; ++cam) {
    bool known = true;  // where it stands is held, or a prior says it
    for (int i = offsets.pose[cam]; i < offsets.pose[cam] + 6; ++i) {
      known =
          known && (constraints.held[i] || std::any_of(constraints.priors.begin(), constraints.priors.end(),
                                                       [&](const PriorTerm& p) { return p.index == i; }));
    }
    if (!known && groups.of_cam[cam] != groups.of_cam[0]) return gap_error(cal.data, sights, groups, "");
  }
  return {};
}

Status check_held_without_start(const Calibration& empty, const Constraints& constraints,
                                const RefineOptions& options) {
  const char* next = "give a start (--start FILE, or an earlier calibration)";
  if (!options.only.empty())
    return Error{ErrorCode::kInvalidData,
                 std::string("the other cameras cannot be held without numbers for them; ") + next,
                 "only '" + options.only[0] + "'"};
  const auto has_value = [&](int i) {
    return std::any_of(constraints.values.begin(), constraints.values.end(),
                       [&](const auto& v) { return constraints.tied_to[v.first] == constraints.tied_to[i]; });
  };
  const auto refusal = [&](std::string what, int i) {
    return Error{ErrorCode::kInvalidData, std::move(what) + next,
                 "fixed parameter '" + holder_of(empty, options, i) + "'"};
  };
  const Offsets offsets = offsets_of(empty);
  const std::vector<std::string> names = shared_parameter_names(empty);
  for (std::size_t cam = 0; cam < offsets.lens.size(); ++cam) {
    for (int i = offsets.lens[cam]; i < offsets.lens[cam] + 2; ++i) {
      if (!constraints.held[i] || has_value(i)) continue;
      return refusal(fmt::format("{} cannot be held without a number for it; give one ('{}=532.8'), or ",
                                 names[i], names[i]),
                     i);
    }
  }
  for (int at : offsets.pose) {
    if (at < 0) continue;
    int n_held = 0, n_given = 0;
    for (int i = at; i < at + 6; ++i) {
      n_held += constraints.held[i];
      n_given += has_value(i);
    }
    if (n_held == 6 && n_given == 0)
      return refusal("a whole pose cannot be held without numbers for it; ", at);
  }
  return {};
}

Status check_ties_beside_spline(const Calibration& cal, const SolveSpec& spec) {
  if (spec.solver == Solver::kBlocks && block_solver_can(cal, spec)) return {};
  bool tied = false;
  for (int i = 0; i < static_cast<int>(spec.tied_to.size()); ++i)
    tied |= spec.tied_to[i] != i && (spec.held.empty() || !spec.held[i]);
  for (const Camera& camera : cal.rig.cameras) {
    if (!tied || !is_sparse(camera.lens)) continue;
    return Error{
        ErrorCode::kUnsupported,
        "ties beside a splined lens need the block solver, which takes neither rotations that are held in "
        "part nor more than 3000 shared parameters; leave out the tie, hold the whole rotation, or choose "
        "a coarser spline",
        "camera " + camera.name};
  }
  return {};
}

}  // namespace plumbline::detail
