// SPDX-License-Identifier: Apache-2.0
#include "refine/bundle_setup.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plumbline/core/text.hpp"

namespace plumbline::detail {
namespace {

constexpr int kLeastViews = 2;   // two rays place a point
constexpr int kLeastPoints = 3;  // six unknowns of a pose
// Rays that are parallel to this [rad] carry no depth for any camera (a hundredth of a pixel is 1e-5 rad at a
// focal length of 1000 px), and the 3x3 block of such a point has a condition of 1e12.
constexpr double kParallelRays = 1e-6;

Error bad_option(std::string message, std::string where) {
  return {ErrorCode::kInvalidData, std::move(message), std::move(where)};
}

std::string all_names(const Reconstruction& scene) {
  std::vector<std::string> names;
  for (const Camera& camera : scene.cameras) {
    if (is_sparse(camera.lens)) continue;
    for (std::string_view name : param_names(camera.lens)) {
      if (std::find(names.begin(), names.end(), name) == names.end()) names.emplace_back(name);
    }
  }
  return join(names, ", ");
}

// Which parameters of each camera's lens are free.
Result<std::vector<std::vector<bool>>> free_parameters(const Reconstruction& scene,
                                                       const std::vector<std::string>& wanted) {
  std::vector<std::vector<bool>> free;
  for (const Camera& camera : scene.cameras) free.emplace_back(n_params(camera.lens), false);
  for (const std::string& name : wanted) {
    bool found = false;
    for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
      const auto names = param_names(scene.cameras[c].lens);
      for (std::size_t i = 0; i < names.size(); ++i) {
        const bool meant =
            name == "all" || name == names[i] || name == scene.cameras[c].name + " " + std::string(names[i]);
        if (!meant) continue;
        if (is_sparse(scene.cameras[c].lens)) {
          return bad_option(fmt::format("a bundle holds lens {}, which has {} parameters; name those of the "
                                        "other cameras, or give the camera a lens with fewer",
                                        lens_name(scene.cameras[c].lens), names.size()),
                            "free intrinsics '" + name + "'");
        }
        free[c][i] = found = true;
      }
    }
    if (!found) {
      return bad_option("no lens has a parameter of this name; there are " + all_names(scene) +
                            ", each also behind a camera's name, and all",
                        "free intrinsics '" + name + "'");
    }
  }
  return free;
}

// The steps of one lens: a unit vector for each free parameter, or fx with its share of fy.
MatX lens_steps(const Lens& lens, std::vector<bool> free, bool tie_focal, std::vector<std::string>& names,
                const std::string& camera) {
  const bool tied = tie_focal && (free[0] || free[1]);
  if (tied) free[0] = true, free[1] = false;
  std::vector<int> columns;
  for (std::size_t i = 0; i < free.size(); ++i) {
    if (!free[i]) continue;
    columns.push_back(static_cast<int>(i));
    names.push_back(camera + " " + std::string(param_names(lens)[i]));
  }
  MatX M = MatX::Zero(static_cast<Eigen::Index>(free.size()), static_cast<Eigen::Index>(columns.size()));
  for (std::size_t j = 0; j < columns.size(); ++j) M(columns[j], static_cast<Eigen::Index>(j)) = 1;
  if (tied) M(1, 0) = params(lens)[1] / params(lens)[0];
  return M;
}

Status mark(std::vector<bool>& marks, const std::vector<int>& indices, const std::string& what) {
  for (int i : indices) {
    if (i < 0 || i >= static_cast<int>(marks.size()))
      return bad_option(fmt::format("there is no {} {}; there are {}", what, i, marks.size()), "hold");
    marks[i] = true;
  }
  return {};
}

Status check(const ScaleBar& bar, int n_points) {
  const std::string where = fmt::format("scale bar {},{}", bar.point_a, bar.point_b);
  if (std::min(bar.point_a, bar.point_b) < 0 || std::max(bar.point_a, bar.point_b) >= n_points ||
      bar.point_a == bar.point_b)
    return bad_option(fmt::format("two different points of {} are needed", n_points), where);
  if (!(bar.length_m > 0 && bar.sigma_m > 0) || !std::isfinite(bar.length_m + bar.sigma_m))
    return bad_option(fmt::format("length {} and sigma {} must be positive", bar.length_m, bar.sigma_m),
                      where);
  return {};
}

// Sightings of each point, and of each view, as ranges of one list.
std::vector<std::vector<int>> sightings_by_point(const Reconstruction& scene) {
  std::vector<std::vector<int>> lists(scene.p_world.size());
  for (std::size_t i = 0; i < scene.sightings.size(); ++i)
    lists[scene.sightings[i].point].push_back(static_cast<int>(i));
  return lists;
}

}  // namespace

Result<BundleSetup> make_setup(const Reconstruction& scene, const BundleOptions& options) {
  BundleSetup setup;
  if (!(options.loss_scale > 0))
    return bad_option(fmt::format("loss scale {}", options.loss_scale), "options");
  if (options.max_iterations < 1)
    return bad_option(fmt::format("{} iterations", options.max_iterations), "options");
  const auto free = free_parameters(scene, options.free_intrinsics);
  if (!free) return free.error();
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    const Camera& camera = scene.cameras[c];
    setup.lens_step.push_back(
        lens_steps(camera.lens, (*free)[c], options.tie_focal, setup.lens_names, camera.name));
  }
  setup.view_held.assign(scene.views.size(), false);
  setup.point_held.assign(scene.p_world.size(), false);
  setup.point_shared.assign(scene.p_world.size(), false);
  if (auto status = mark(setup.view_held, options.hold_views, "view"); !status) return status.error();
  if (auto status = mark(setup.point_held, options.hold_points, "point"); !status) return status.error();
  std::vector<bool> unused_views = setup.view_held, unused_points = setup.point_held;
  if (auto status = mark(unused_views, options.covariance_of_views, "view"); !status) return status.error();
  if (auto status = mark(unused_points, options.covariance_of_points, "point"); !status)
    return status.error();
  for (const ScaleBar& bar : options.scale_bars) {
    if (auto status = check(bar, static_cast<int>(scene.p_world.size())); !status) return status.error();
    for (int point : {bar.point_a, bar.point_b})
      if (!setup.point_held[point]) setup.point_shared[point] = true;
  }
  setup.bars = options.scale_bars;
  return setup;
}

namespace {

// Counts of one point: its views (each once), and whether its rays differ.
struct PointSupport {
  int n_views = 0;
  bool parallel = true;
};

PointSupport support_of(const Reconstruction& scene, const std::vector<int>& sightings,
                        const std::vector<bool>& used, const std::vector<Vec3>& centres) {
  PointSupport support;
  std::vector<int> views;
  for (int i : sightings) {
    if (used[i]) views.push_back(scene.sightings[i].view);
  }
  std::sort(views.begin(), views.end());
  views.erase(std::unique(views.begin(), views.end()), views.end());
  support.n_views = static_cast<int>(views.size());
  for (int v : views) {
    const Vec3& p = scene.p_world[scene.sightings[sightings[0]].point];
    const Vec3 first = (p - centres[views[0]]).normalized(), ray = (p - centres[v]).normalized();
    if (!(first.cross(ray).norm() < kParallelRays && first.dot(ray) > 0)) support.parallel = false;
  }
  return support;
}

}  // namespace

Participation participation_of(const Reconstruction& scene, const BundleSetup& setup) {
  Participation part;
  const std::size_t n = scene.sightings.size();
  part.view.assign(scene.views.size(), true);
  part.point.assign(scene.p_world.size(), true);
  part.projects.resize(n);
  std::vector<Vec3> centres;
  for (const ReconstructionView& view : scene.views) centres.push_back(view.T_cam_world.centre());
  for (std::size_t i = 0; i < n; ++i) part.projects[i] = predict(scene, scene.sightings[i]).has_value();
  part.sighting = part.projects;
  const auto by_point = sightings_by_point(scene);
  const auto leave_out = [&](LeftOut::What what, std::size_t index, std::string reason) {
    (what == LeftOut::What::kView ? part.view : part.point)[index] = false;
    part.left_out.push_back({what, static_cast<int>(index), std::move(reason)});
  };
  // A point that goes may leave a view with too few, and the other way round.
  for (bool changed = true; changed;) {
    changed = false;
    std::vector<int> points_of(scene.views.size(), 0);
    for (std::size_t p = 0; p < by_point.size(); ++p) {
      if (!part.point[p]) continue;
      const PointSupport support = support_of(scene, by_point[p], part.sighting, centres);
      const int least = setup.point_held[p] ? 1 : kLeastViews;
      if (support.n_views < least)
        leave_out(LeftOut::What::kPoint, p,
                  fmt::format("it is seen in {} view{}, {} are needed", support.n_views,
                              support.n_views == 1 ? "" : "s", least));
      else if (support.parallel && !setup.point_held[p])
        leave_out(LeftOut::What::kPoint, p,
                  "its rays are parallel to within 1e-6 rad: its distance is not seen");
      for (int i : by_point[p]) {
        if (!part.point[p] && part.sighting[i]) part.sighting[i] = false, changed = true;
        if (part.sighting[i]) ++points_of[scene.sightings[i].view];
      }
    }
    for (std::size_t v = 0; v < scene.views.size(); ++v) {
      const int least = setup.view_held[v] ? 1 : kLeastPoints;
      if (!part.view[v] || points_of[v] >= least) continue;
      leave_out(LeftOut::What::kView, v,
                fmt::format("it sees {} usable point{}, {} are needed", points_of[v],
                            points_of[v] == 1 ? "" : "s", least));
      changed = true;
    }
    for (std::size_t i = 0; i < n; ++i) {
      if (part.sighting[i] && !part.view[scene.sightings[i].view]) part.sighting[i] = false;
    }
  }
  part.n_sightings = static_cast<int>(std::count(part.sighting.begin(), part.sighting.end(), true));
  return part;
}

SharedColumns shared_columns(const Reconstruction& scene, const BundleSetup& setup,
                             const Participation& part) {
  SharedColumns columns;
  std::vector<bool> camera_used(scene.cameras.size(), false);
  for (std::size_t v = 0; v < scene.views.size(); ++v) {
    if (part.view[v]) camera_used[scene.views[v].camera] = true;
  }
  const auto add = [&](std::vector<int>& where, int n) {
    where.push_back(n > 0 ? columns.total : -1);
    columns.total += n;
  };
  for (std::size_t c = 0; c < scene.cameras.size(); ++c)
    add(columns.lens, camera_used[c] ? static_cast<int>(setup.lens_step[c].cols()) : 0);
  for (std::size_t v = 0; v < scene.views.size(); ++v)
    add(columns.view, part.view[v] ? setup.view_steps(static_cast<int>(v)) : 0);
  for (std::size_t p = 0; p < scene.p_world.size(); ++p)
    add(columns.point, part.point[p] && setup.point_shared[p] ? 3 : 0);
  return columns;
}

int count_free(const SharedColumns& columns, const BundleSetup& setup, const Participation& part) {
  int n = columns.total;
  for (std::size_t p = 0; p < part.point.size(); ++p)
    n += part.point[p] && !setup.point_held[p] && !setup.point_shared[p] ? 3 : 0;
  return n;
}

}  // namespace plumbline::detail
