// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rig/reconstruction.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace plumbline {
namespace {

constexpr double kUnitQuaternion = 1e-6;  ///< what a quaternion written with seven digits is off

bool all_finite(std::span<const double> x) {
  return std::all_of(x.begin(), x.end(), [](double v) { return std::isfinite(v); });
}

std::optional<std::string> fault_of(const Camera& camera) {
  const std::span<const double> k = params(camera.lens);
  if (!all_finite(k)) return "a parameter of its lens is not finite";
  if (!(k[0] > 0 && k[1] > 0))
    return fmt::format("focal lengths {} and {} px; they are positive", k[0], k[1]);
  if (camera.size.width < 0 || camera.size.height < 0)
    return fmt::format("image size {}x{}", camera.size.width, camera.size.height);
  return std::nullopt;
}

std::optional<std::string> fault_of(const ReconstructionView& view, std::size_t n_cameras) {
  if (view.camera < 0 || view.camera >= static_cast<int>(n_cameras))
    return fmt::format("camera index {} of {}", view.camera, n_cameras);
  const auto& qt = view.T_cam_world.qt;
  if (!all_finite(qt)) return "its pose is not finite";
  const double norm = std::hypot(std::hypot(qt[0], qt[1]), std::hypot(qt[2], qt[3]));
  if (std::abs(norm - 1) > kUnitQuaternion) return fmt::format("its quaternion has the length {}", norm);
  return std::nullopt;
}

std::optional<std::string> fault_of(const Sighting& s, const Reconstruction& scene) {
  if (s.view < 0 || s.view >= static_cast<int>(scene.views.size()))
    return fmt::format("view index {} of {}", s.view, scene.views.size());
  if (s.point < 0 || s.point >= static_cast<int>(scene.p_world.size()))
    return fmt::format("point index {} of {}", s.point, scene.p_world.size());
  if (!s.px.allFinite()) return "its pixel is not finite";
  if (!(s.sigma_px > 0) || !std::isfinite(s.sigma_px))
    return fmt::format("sigma {} px is not a positive number", s.sigma_px);
  return std::nullopt;
}

}  // namespace

Status validate(const Reconstruction& scene) {
  const auto bad = [](std::string message, std::string where) {
    return Error{ErrorCode::kInvalidData, std::move(message), std::move(where)};
  };
  if (scene.cameras.empty()) return bad("the reconstruction has no camera", "");
  for (const Camera& camera : scene.cameras) {
    if (auto fault = fault_of(camera)) return bad(*std::move(fault), "camera " + camera.name);
  }
  for (std::size_t v = 0; v < scene.views.size(); ++v) {
    if (auto fault = fault_of(scene.views[v], scene.cameras.size()))
      return bad(*std::move(fault), view_name(scene, static_cast<int>(v)));
  }
  for (std::size_t p = 0; p < scene.p_world.size(); ++p) {
    if (!scene.p_world[p].allFinite())
      return bad("its coordinates are not finite", fmt::format("point {}", p));
  }
  for (std::size_t i = 0; i < scene.sightings.size(); ++i) {
    if (auto fault = fault_of(scene.sightings[i], scene))
      return bad(*std::move(fault), fmt::format("sighting {}", i));
  }
  if (!scene.tags.empty() && scene.tags.size() != scene.p_world.size())
    return bad(fmt::format("{} tags for {} points", scene.tags.size(), scene.p_world.size()), "");
  return {};
}

std::optional<Vec2> predict(const Reconstruction& scene, const Sighting& s) {
  const ReconstructionView& view = scene.views[s.view];
  return project(scene.cameras[view.camera].lens, view.T_cam_world * scene.p_world[s.point]);
}

std::string view_name(const Reconstruction& scene, int view) {
  const std::string& image = scene.views[view].image;
  return image.empty() ? fmt::format("view {}", view) : fmt::format("view {} ({})", view, image);
}

std::string point_name(const Reconstruction& scene, int point) {
  const bool has_id = static_cast<std::size_t>(point) < scene.tags.size() && scene.tags[point].id >= 0;
  return has_id ? fmt::format("point {} (id {})", point, scene.tags[point].id)
                : fmt::format("point {}", point);
}

}  // namespace plumbline
