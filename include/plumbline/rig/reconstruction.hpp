// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/rig/rig.hpp"

namespace plumbline {

/// One image of a scene. Several views may share a camera, and with it the lens' parameters.
struct ReconstructionView {
  int camera = 0;     ///< index into Reconstruction::cameras
  std::string image;  ///< file name; empty where none is known
  SE3 T_cam_world;
  std::int64_t id = -1;  ///< the number that a file of other software gave it; -1: none
};

/// One scene point seen in one view.
struct Sighting {
  int view = 0;            ///< index into Reconstruction::views
  int point = 0;           ///< index into Reconstruction::p_world
  Vec2 px = Vec2::Zero();  ///< [px], pixel centres at integers
  double sigma_px = 1.0;   ///< expected error of each coordinate
};

/// What files say of a point besides where it is.
struct PointTag {
  std::int64_t id = -1;  ///< its number in the file it came from; -1: none
  std::array<std::uint8_t, 3> rgb{128, 128, 128};
};

/// Cameras, views and points of a scene of unknown shape, and what was seen of it: the input and the output
/// of a bundle adjustment. World frame and unit of length are whatever the poses and the points share (metres
/// only where something gave it metres).
struct Reconstruction {
  std::vector<Camera> cameras;  ///< a size of 0x0 is allowed: not known
  std::vector<ReconstructionView> views;
  std::vector<Vec3> p_world;
  std::vector<Sighting> sightings;
  std::vector<PointTag> tags;  ///< one per point, or empty
};

/// kInvalidData names the first fault: no camera, an index out of range, a number that is not finite, a focal
/// length or a sigma that is not positive, a quaternion off unit length by more than 1e-6, `tags` of another
/// length than the points.
Status validate(const Reconstruction& scene);

/// px = lens(T_cam_world * p_world) of one sighting; nullopt outside the lens' domain. \pre its indices are
/// valid
std::optional<Vec2> predict(const Reconstruction& scene, const Sighting& sighting);

/// How messages speak of them: "view 3 (img3.jpg)", "point 12 (id 7041)".
std::string view_name(const Reconstruction& scene, int view);
std::string point_name(const Reconstruction& scene, int point);

}  // namespace plumbline
