// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"

namespace plumbline {

/// Up to where a camera's calibration holds: a cone about the optical axis. See rig/validity.hpp.
struct Validity {
  double angle_rad = 0;  ///< largest angle from the axis, in (0, pi]
  double radius_px = 0;  ///< the same seen in the image: distance from (cx, cy), least over all directions
};

struct Camera {
  std::string name;  ///< unique within the rig
  ImageSize size;
  Lens lens;
  std::optional<Validity> validity = {};  ///< nullopt: as far as the domain of the lens reaches
};

/// What you ship. One camera is a rig of one, a stereo pair a rig of two.
struct Rig {
  std::vector<Camera> cameras;
  std::vector<SE3>
      T_cam_rig;  ///< one per camera: p_cam = T_cam_rig[i] * p_rig; [0] is the identity by convention

  /// Index of the camera with that name.
  std::optional<int> find(std::string_view name) const;
};

}  // namespace plumbline
