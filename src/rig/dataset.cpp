// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rig/dataset.hpp"

#include <fmt/format.h>

#include <cmath>
#include <set>
#include <tuple>

namespace plumbline {
namespace {

std::optional<std::string> fault_of(const View& view, const Dataset& data) {
  const int n_cams = static_cast<int>(data.cameras.size()), n_frames = static_cast<int>(data.frames.size());
  if (view.cam < 0 || view.cam >= n_cams) return fmt::format("camera index {} of {}", view.cam, n_cams);
  if (view.frame < 0 || view.frame >= n_frames)
    return fmt::format("frame index {} of {}", view.frame, n_frames);
  const int n_targets = static_cast<int>(data.targets.size());
  if (view.target < 0 || view.target >= n_targets)
    return fmt::format("target index {} of {}", view.target, n_targets);
  const std::size_t n_points = data.targets[view.target].points.size();
  const ImageSize size = data.cameras[view.cam].size;
  if (view.time_s && !std::isfinite(*view.time_s)) return "its time is not finite";
  int previous = -1;
  for (const Corner& c : view.corners) {
    if (c.point < 0 || c.point >= static_cast<int>(n_points)) {
      return fmt::format("point {} of a target with {} points", c.point, n_points);
    }
    if (c.point <= previous) return fmt::format("point {} is out of order or there twice", c.point);
    previous = c.point;
    if (!c.px.allFinite()) return fmt::format("the pixel of point {} is not finite", c.point);
    // Generous: a corner finder may extrapolate a little beyond the border.
    if (c.px.x() < -0.5 * size.width || c.px.x() > 1.5 * size.width || c.px.y() < -0.5 * size.height ||
        c.px.y() > 1.5 * size.height) {
      return fmt::format("point {} at ({:.6g}, {:.6g}) px is far outside the {}x{} image", c.point, c.px.x(),
                         c.px.y(), size.width, size.height);
    }
    if (!(c.sigma_px > 0) || !std::isfinite(c.sigma_px)) {
      return fmt::format("sigma {} px of point {} is not a positive number", c.sigma_px, c.point);
    }
  }
  return std::nullopt;
}

}  // namespace

Status validate(const Dataset& data) {
  const auto bad = [](std::string message, std::string where) {
    return Error{ErrorCode::kInvalidData, std::move(message), std::move(where)};
  };
  if (data.cameras.empty()) return bad("the data set has no camera", "");
  std::set<std::string> names;
  for (const CameraInfo& camera : data.cameras) {
    if (camera.size.width <= 0 || camera.size.height <= 0) {
      return bad(fmt::format("image size {}x{}", camera.size.width, camera.size.height),
                 "camera " + camera.name);
    }
    if (!names.insert(camera.name).second) return bad("two cameras have this name", "camera " + camera.name);
  }
  if (data.targets.empty()) return bad("the data set has no target", "");
  for (std::size_t i = 0; i < data.targets.size() && data.targets.size() > 1; ++i) {
    const std::string& name = data.targets[i].name;
    if (!names.insert(name).second)
      return bad("two boards, or a board and a camera, have this name; give each a name of its own",
                 "target " + name);
  }
  std::set<std::tuple<int, int, int>> seen;
  for (const View& view : data.views) {
    if (auto fault = fault_of(view, data)) return bad(*std::move(fault), "view " + view.image);
    if (!seen.insert({view.cam, view.frame, view.target}).second) {
      return bad(fmt::format("camera {} has two images for frame {}", data.cameras[view.cam].name,
                             data.frames[view.frame]),
                 "view " + view.image);
    }
  }
  return {};
}

}  // namespace plumbline
