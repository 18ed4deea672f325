// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <vector>

#include "linear/dlt.hpp"
#include "plumbline/core/result.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"

/// What the closed forms of a pose from rays share. Private to the module.
namespace plumbline::detail {

/// Points thinner than this fraction of their extent also start from the homography of their best plane: it
/// is exact for a flat board, and for a bowed one it is a better start than a DLT that lives on the bow.
inline constexpr double kNearlyFlat = 0.05;

/// The points a lens can see, with their rays.
struct RaySighting {
  std::vector<Vec3> p_board;
  std::vector<Vec3> rays_cam;
};
RaySighting unproject_all(const Lens& lens, std::span<const Vec3> p_board, std::span<const Vec2> px);

struct PoseCandidate {
  SE3 T_cam_board;
  double cost = 0;  ///< sum of squared chords between the unit rays and the unit directions of T p
};

/// Gauss-Newton with halving on the chords, from `start`; it also ends when a step gains less than
/// `least_gain` of the cost.
PoseCandidate polish(const RaySighting& s, const SE3& start, int max_iterations = 15, double least_gain = 0);

/// The best plane of the points: its frame has their centroid as origin and its normal as z.
SE3 plane_frame(const Spread& spread);

}  // namespace plumbline::detail
