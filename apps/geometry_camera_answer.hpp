// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "geometry_args.hpp"

namespace plumbline::apps {

/// The keys P K R t C: P = K [R t], C = -R' t.
Json json_of_camera(const Mat3& K, const SE3& T_cam_world);

/// Flags of the rows that `kept` set, spread over all rows; false for the others.
std::vector<bool> spread(const std::vector<bool>& flags, const std::vector<bool>& kept);

/// "3 pixels have no ray in the lens: lines 4, 9, 12", nothing when all are seen.
std::string text_of_outside(const std::vector<bool>& seen, const std::vector<int>& lines);

}  // namespace plumbline::apps
