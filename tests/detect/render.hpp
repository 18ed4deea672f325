// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "plumbline/detect/detect.hpp"
#include "plumbline/target/target.hpp"

/// Boards drawn from formulas, not by the library: each pixel is the mean of the board's brightness over its
/// area, so the true place of every point is known exactly.
namespace plumbline::test {

/// A camera that looks at the plane z = 0 of a board: pinhole, or equidistant (r = f theta), which is no
/// homography.
struct PlaneCamera {
  ImageSize size{640, 480};
  double f = 500;
  bool is_fisheye = false;
  Vec2 centre{319.5, 239.5};
  Mat3 R = Mat3::Identity();  ///< camera from board
  Vec3 t{0, 0, 1};
  std::optional<Vec2> board_of(const Vec2& px) const;
  Vec2 px_of(const Vec3& p_board) const;
};

/// A camera that sees the middle of `target` at `distance` board widths, turned by these angles [deg] about
/// the board's x and y axes and about its own axis. `y_up` for AprilGrids (the camera must look from the
/// printed side).
PlaneCamera look_at(const Target& target, double pitch_deg, double yaw_deg, double roll_deg,
                    double distance = 1.7);

/// Brightness 0..1 of a board point; -1 outside of the sheet.
using Shade = std::function<double(const Vec2&)>;
Shade chessboard_shade(const Chessboard& board);
Shade charuco_shade(const Charuco& board, bool legacy, bool negative = false);
Shade aprilgrid_shade(const AprilGrid& board);
Shade circles_shade(const Circles& board, double diameter_m);

struct Render {
  int samples = 5;       ///< per pixel and axis
  double blur_px = 0.7;  ///< Gaussian, the lens
  double noise = 0;      ///< grey levels
  int black = 30, white = 210, background = 130;
  std::uint64_t seed = 1;
};
cv::Mat render(const PlaneCamera& camera, const Shade& shade, const Render& how = {});

/// How a detection lies about the truth.
struct Accuracy {
  int found = 0;
  double mean_error = 0, worst = 0, rms_axis = 0, mean_sigma = 0;
  Vec2 bias = Vec2::Zero();
};
Accuracy accuracy(const Detection& detection, const Target& target, const PlaneCamera& camera);

}  // namespace plumbline::test
