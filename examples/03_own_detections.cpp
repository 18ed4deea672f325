// SPDX-License-Identifier: Apache-2.0
// Corners that another program found. Here a simulated camera stands in for that program, so the truth is
// known: without noise the calibration must give it back.
#include <cmath>
#include <cstdio>
#include <plumbline/refine/refine.hpp>

using namespace plumbline;

namespace {

int fail(const Error& error) {
  std::fprintf(stderr, "%s\n", error.text().c_str());
  return 1;
}

/// Boards turned about all three axes, half a metre in front of the camera, their middle near the optical
/// axis.
SE3 board_pose(const Target& target, int view) {
  const double turn = 0.9 * view;
  Vec6 rotation = Vec6::Zero();
  rotation.head<3>() = Vec3(0.5 * std::cos(turn), 0.5 * std::sin(turn), 0.1 * view);
  const Mat3 R = se3_exp(rotation).R();
  const Vec3 middle = 0.5 * (target.points.front() + target.points.back());
  return SE3(R, Vec3(0.05 * std::sin(2 * turn), 0.04 * std::cos(3 * turn), 0.5) - R * middle);
}

}  // namespace

int main() {
  const auto target = make_target(Chessboard{.columns = 9, .rows = 6, .square_m = 0.025});
  if (!target) return fail(target.error());
  const ImageSize size{640, 480};
  const double parameters[] = {530, 535, 322, 238, -0.28, 0.09, 0.0012, -0.0008, 0.02};
  const auto truth = make_lens("opencv5", parameters);
  if (!truth) return fail(truth.error());

  // What a Dataset needs: the target, the cameras, the frames, and the corners of each view by point id.
  Dataset data{.targets = {*target}, .cameras = {{"camera", size}}};
  for (int i = 0; i < 12; ++i) {
    const SE3 T_cam_board = board_pose(*target, i);
    View view{.cam = 0, .frame = i, .image = "view" + std::to_string(i)};
    for (int point = 0; point < int(target->points.size()); ++point) {
      const auto px = project(*truth, T_cam_board * target->points[point]);
      const bool inside =
          px && px->x() >= 0 && px->y() >= 0 && px->x() <= size.width - 1 && px->y() <= size.height - 1;
      if (inside) view.corners.push_back({.point = point, .px = *px});
    }
    data.frames.push_back(std::to_string(i));
    data.views.push_back(view);
  }
  if (const auto valid = validate(data); !valid) return fail(valid.error());

  const auto calibration = calibrate(data, {.lenses = {"opencv5"}});
  if (!calibration) return fail(calibration.error());
  const auto found = params(calibration->rig.cameras[0].lens);
  double worst = 0;
  for (std::size_t i = 0; i < found.size(); ++i) worst = std::max(worst, std::abs(found[i] - parameters[i]));
  std::printf("%d corners, RMS %.1e px, fx %.6f px, largest parameter error %.1e\n",
              calibration->stats.n_corners, calibration->stats.rms_px, found[0], worst);
  return worst < 1e-6 ? 0 : 1;
}
