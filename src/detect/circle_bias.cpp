// SPDX-License-Identifier: Apache-2.0
#include "plumbline/detect/circle_bias.hpp"

#include <cmath>
#include <numbers>

#include "detect/outline.hpp"
#include "plumbline/core/check.hpp"

namespace plumbline {

std::optional<DiscImage> disc_image(const Lens& lens, const SE3& T_cam_board, const Vec3& centre_board,
                                    double diameter_m) {
  PLUMBLINE_CHECK(diameter_m > 0, "a circle needs a diameter");
  constexpr int kPoints = 48;
  const auto centre = project(lens, T_cam_board * centre_board);
  if (!centre) return std::nullopt;
  const Mat3 R = T_cam_board.R();
  detail::OutlineSum sum(kPoints);
  for (int i = 0; i < kPoints; ++i) {
    const double angle = 2 * std::numbers::pi * i / kPoints, radius = diameter_m / 2;
    const Vec3 out = radius * Vec3(std::cos(angle), std::sin(angle), 0);
    const Vec3 along = radius * Vec3(-std::sin(angle), std::cos(angle), 0);
    Mat23 J;
    const auto px = project(lens, T_cam_board * (centre_board + out), &J);
    if (!px) return std::nullopt;
    sum.add(*px - *centre, J * (R * along));  // from the centre, so that no digits are lost
  }
  if (!(std::abs(sum.area()) > 0)) return std::nullopt;
  return DiscImage{*centre + sum.centroid(), *centre, std::abs(sum.area())};
}

}  // namespace plumbline
