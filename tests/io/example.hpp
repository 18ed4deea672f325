// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "plumbline/core/random.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/rig/calibration.hpp"

namespace plumbline::test {

/// Two cameras, three frames, five views: one frame without a pose, one view without a board, one that was
/// not used. Its numbers have all their digits.
inline Calibration example_calibration() {
  Rng rng(7);
  Calibration c;
  c.rig.cameras.push_back(
      {"left",
       {640, 480},
       make_lens("opencv5", {{533.1, 533.2, 342.3, 234.4, -0.28, 0.025, 1e-3, -1.0 / 7000, 0.16}}).value()});
  c.rig.cameras.push_back(
      {"right eye: 2",
       {752, 480},
       make_lens("kb4", {{400.0 / 3, 401, 320, 240, 0.01, -0.02, 1e-300, -0.0}}).value()});
  c.rig.cameras[1].validity = Validity{1.0 / 0.9, 148.0 / 3};
  c.rig.T_cam_rig = {SE3(), SE3(so3_exp({0.01, -0.02, 0.003}), {-0.1, 1.0 / 3000, 0.002})};
  c.data.targets = {make_target(Chessboard{3, 2, 0.025}).value()};
  c.data.cameras = {{"left", {640, 480}}, {"right eye: 2", {752, 480}}};
  c.data.frames = {"01", "2", "x y"};
  c.data.detector = "chessboard: cornerSubPix";
  for (const auto& [cam, frame] : {std::pair{0, 0}, {0, 1}, {0, 2}, {1, 0}, {1, 1}}) {
    View view{cam, frame, (cam ? "img/right" : "img/left") + c.data.frames[frame] + ".jpg", {}, ""};
    std::vector<CornerFit> fits;
    if (cam == 0 && frame == 2) view.reason = "no board: 3 of 6 corners";
    for (int i = 0; i < (view.reason.empty() ? 6 : 0); ++i) {
      view.corners.push_back({i, {rng.uniform(0, 640), rng.uniform(0, 480)}, rng.uniform(0.05, 1)});
      fits.push_back({{rng.normal(0.1), rng.normal(0.1)}, i == 4});
    }
    const bool unused = cam == 1 && frame == 1;
    c.fits.push_back(unused ? std::vector<CornerFit>{} : fits);
    c.view_reason.push_back(unused ? "only 6 corners" : "");
    c.data.views.push_back(view);
  }
  c.T_rig_board = {SE3(so3_exp({0.3, 0.2, -0.1}), {0.01, 0.02, 0.7}),
                   SE3(so3_exp({-2.3, 1.2, -0.1}), {0.1, 0.2, 0.9}), std::nullopt};
  c.stats = {0.31,
             0.31 / std::sqrt(2.0),
             17,
             3,
             12,
             true,
             "cost change: 1e-12",
             {{"left fx (+0.71), left fy (+0.70)", 12.5, "tilt the board"}}};
  const auto n = static_cast<Eigen::Index>(shared_parameter_names(c.rig).size());
  c.covariance = MatX::NullaryExpr(n, n, [&] { return rng.normal(); });
  c.provenance = {"0.1.0", {{"lens", "left=opencv5,right=kb4"}, {"seed", "0"}}, corners_hash(c.data)};
  c.provenance.lens_tries = {{"left", "opencv5", 9, 0.31, 0.32, 0, 0, true, ""},
                             {"left", "kb4", 8, 1.0 / 3, 0, 0.01, 0.001, false, "its \"fit\": poor"}};
  return c;
}

/// The same with a second board that three views show.
inline Calibration example_of_two_boards() {
  Calibration c = example_calibration();
  c.data.targets.push_back(make_target(Charuco{}, "the other: board").value());
  c.T_board0_board.push_back(SE3(so3_exp({0.4, -0.2, 1.0 / 3}), {0.3, -0.1, 1.0 / 7}));
  for (std::size_t v : {0, 3, 2}) {
    View view = c.data.views[v];
    view.target = 1;
    c.data.views.push_back(view);
    c.fits.push_back(c.fits[v]);
    c.view_reason.push_back(c.view_reason[v]);
  }
  Rng rng(8);
  const auto n = static_cast<Eigen::Index>(shared_parameter_names(c).size());
  c.covariance = MatX::NullaryExpr(n, n, [&] { return rng.normal(); });
  return c;
}

}  // namespace plumbline::test
