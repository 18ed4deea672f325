// SPDX-License-Identifier: Apache-2.0
#include "geometry_camera_answer.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "plumbline/core/text.hpp"

namespace plumbline::apps {

Json json_of_camera(const Mat3& K, const SE3& T_cam_world) {
  return {{"P", json_of_matrix(K * T_cam_world.matrix34())},
          {"K", json_of_matrix(K)},
          {"R", json_of_matrix(T_cam_world.R())},
          {"t", json_of_vector(T_cam_world.t())},
          {"C", json_of_vector(T_cam_world.centre())}};
}

std::vector<bool> spread(const std::vector<bool>& flags, const std::vector<bool>& kept) {
  std::vector<bool> out(kept.size(), false);
  std::size_t next = 0;
  for (std::size_t i = 0; i < kept.size(); ++i)
    if (kept[i]) out[i] = flags.at(next++);
  return out;
}

std::string text_of_outside(const std::vector<bool>& seen, const std::vector<int>& lines) {
  std::vector<std::string> where;
  for (std::size_t i = 0; i < seen.size(); ++i)
    if (!seen[i] && where.size() < 20) where.push_back(std::to_string(lines.at(i)));
  const auto n = std::count(seen.begin(), seen.end(), false);
  if (n == 0) return "";
  return fmt::format("{} of {} rows left out, because a pixel has no ray in its lens: line{} {}{}\n", n,
                     seen.size(), n == 1 ? "" : "s", join(where, ", "), n > 20 ? ", ..." : "");
}

}  // namespace plumbline::apps
