// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>

#include "plumbline/core/result.hpp"
#include "plumbline/rig/rig.hpp"

namespace plumbline {

/// Projection difference of two cameras over a grid of the first one's image [px].
struct DiffPx {
  double rms = 0, p95 = 0, max = 0;
  int n_samples = 0;             ///< grid points that both lenses project, within both cameras' validity
  double compared_fraction = 0;  ///< of the grid points of the image; below 1 where a domain or a validity
                                 ///< ends inside it
};

/// How the two cameras' frames are brought together before they are compared.
enum class Align {
  kNone,      ///< not at all: the same ray through both
  kRotation,  ///< the rotation that fits best: for points far away
  kPose,      ///< the rotation and translation that fit best, for points at `distance_m`
};

/// Unprojects a 60 x 45 grid of a's image with lens a, projects with lens b, and takes the distances.
/// kInvalidData when the image sizes differ; kDegenerate when fewer than 10 grid points can be compared.
Result<DiffPx> compare_cameras(const Camera& a, const Camera& b, Align align = Align::kNone,
                               double distance_m = 1.0);

/// A projection that is not one of our lenses: the pixel of p_cam, nullopt where it has none, and
/// d(px)/d(p_cam) on request.
using Projection = std::function<std::optional<Vec2>(const Vec3& p_cam, Mat23* J_px_p)>;

/// As compare_cameras with any projection in b's place. `wanted` picks the grid points [px of a] to compare;
/// empty: all. n_samples and compared_fraction count those compared.
Result<DiffPx> compare_projection(const Camera& a, const Projection& b, Align align = Align::kNone,
                                  double distance_m = 1.0,
                                  const std::function<bool(const Vec2&)>& wanted = {});

}  // namespace plumbline
