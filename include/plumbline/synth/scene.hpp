// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/rig/calibration.hpp"
#include "plumbline/synth/board.hpp"
#include "plumbline/synth/render.hpp"

namespace plumbline {

/// What to simulate.
struct SceneOptions {
  std::string lens = "opencv5";  ///< a name of lens_names()
  std::optional<Lens>
      exact_lens;  ///< the first camera's lens, as it is; `lens`, `fov_deg` and the distortion are not used
  double fov_deg = 70;    ///< from the left to the right edge of the image, in the row of the principal point
  bool distorted = true;  ///< a realistic distortion (barrel, up to about 15 % at the corner); else none
  ImageSize size{640, 480};
  int n_views = 20;         ///< frames: positions of the board
  int n_cameras = 1;        ///< side by side along the first camera's x, called cam0, cam1, ...
  double baseline_m = 0.1;  ///< between neighbours
  double noise_px = 0.1;    ///< standard deviation of each corner coordinate; 0: exact projections
  std::uint64_t seed = 0;
};

/// A lens with that field of view, its parameters drawn with the seed: focal length from the field of view,
/// principal point within 1 % of the width from the middle, fy 0.2 % above fx, and the distortion parameters
/// that go by OpenCV's names k1.. p1.. s1.. . kInvalidData: a field of view that the lens cannot have (180
/// degrees and more for those that see only forward, 300 for kb4); kUnsupported: no such lens.
Result<Lens> simulated_lens(std::string_view name, double fov_deg, ImageSize size, bool distorted,
                            std::uint64_t seed);

/// The truth, with corners as a perfect detector of known noise would report them: every point in front of
/// the lens, inside the image by 2 px, on the printed side of its board and not hidden by another board of
/// the target. Boards are spread over the image and tilted by up to 45 degrees (corners of boards by 20),
/// near enough to cover a third to four fifths of the image's smaller side. A chessboard or circle grid that
/// is not seen whole gives no corners in that view, as with a detector; the first camera or (with several)
/// one of them always sees the board. Frames are named "000", "001", ...; view images "cam0/000.png". `fits`
/// holds the noise, stats its RMS. kInvalidData: an option that makes no sense; kDegenerate: no pose was
/// found that shows the target (its size against the baseline).
Result<Calibration> simulate(const Target& target, const SceneOptions& options);

/// Points that a camera sees, exactly projected, sigma_px 1. `drawings` may be empty (free points: nothing
/// hides any).
std::vector<Corner> visible_corners(const Target& target, const std::vector<BoardDrawing>& drawings,
                                    const Camera& camera, const SE3& T_cam_target);

}  // namespace plumbline
