// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>

#include "plumbline/core/check.hpp"
#include "plumbline/detect/circle_bias.hpp"
#include "plumbline/detect/second_look.hpp"

namespace plumbline {

CircleCorrection correct_circles(const SecondLook& look, Calibration& cal) {
  CircleCorrection out;
  for (const CircleCentroids& centroids : look.circles) {
    View& view = cal.data.views[centroids.view];
    PLUMBLINE_CHECK(view.corners.size() == centroids.px.size(), "the corners are those of the second look");
    const auto T_rig_board = board_pose(cal, view);
    if (!T_rig_board) continue;
    const SE3 T = cal.rig.T_cam_rig[view.cam] * *T_rig_board;
    for (std::size_t i = 0; i < view.corners.size(); ++i) {
      Corner& corner = view.corners[i];
      const auto image =
          disc_image(cal.rig.cameras[view.cam].lens, T, board_point(cal, view.target, corner.point),
                     look.diameter_m[view.target]);
      if (!image) continue;
      const Vec2 centre = centroids.px[i] - image->bias_px();
      out.largest_px = std::max(out.largest_px, image->bias_px().norm());
      out.moved_px = std::max(out.moved_px, (centre - corner.px).norm());
      corner.px = centre;
    }
  }
  return out;
}

Result<SettledCircles> settle_circles(const SecondLook& look,
                                      const std::function<Result<Calibration>(const Calibration&)>& solve) {
  constexpr int kMostRounds = 3;
  constexpr double kStandPx = 0.001;
  SettledCircles out{look.start, 0, {}};
  double before = std::numeric_limits<double>::infinity();
  while (out.rounds < kMostRounds) {
    auto solved = solve(out.calibration);
    if (!solved) return solved.error();
    ++out.rounds;
    out.calibration = *std::move(solved);
    Calibration next = out.calibration;
    const CircleCorrection correction = correct_circles(look, next);
    if (correction.moved_px > before / 2) break;
    out.calibration = std::move(next);
    out.last = correction;
    if (correction.moved_px < kStandPx) break;
    before = correction.moved_px;
  }
  return out;
}

}  // namespace plumbline
