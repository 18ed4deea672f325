// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "detect/saddle_kernel.hpp"
#include "plumbline/core/types.hpp"

/// The sub-pixel place of a corner where four fields meet, by least squares on the grey levels themselves:
/// two blurred edges through one point. Every pixel near an edge counts, so that the error is close to the
/// least that the image's noise allows, and the normal equations say how large it is.
namespace plumbline::detail {

/// Which pixels around a corner belong to it. Board units are those of J (a square, a tag).
struct SaddleWindow {
  Mat2 J = Mat2::Identity();  ///< d px / d board: its columns run along the two edges
  /// Where the corner's own edges meet the next line, along both axes [board units].
  Vec2 low{-1, -1}, high{1, 1};
  double across = 1;        ///< where the next edge beside an edge is [board units]
  double leak_blurs = 1.5;  ///< before the next edge, which is felt so far
  /// Of the two edges [1/px]: the edge along column k of J bends towards the side that it has when turned
  /// from x to y. A wide lens bends lines by hundredths of a pixel within a window.
  Vec2 curvature = Vec2::Zero();
  double max_arm_px = 14;    ///< longer arms gain little (the error falls with their root) and see more bend
  double long_arm_px = 0;    ///< where the noise leaves the corner rough; 0: never. Wants `curvature`
  double max_move_px = 3;    ///< from the start
  double usual_blur_px = 0;  ///< of corners beside; 0: not known, and the corner is looked for in steps
  double enough_px = 5e-3;   ///< the last step of the fit; more for one that another follows
  double max_misfit = 0.4;   ///< of the contrast: what the model may leave; photographs of screens reach 0.3
};

inline constexpr double kRoughSigmaPx = 0.02;  ///< from this standard error on longer arms are tried
inline constexpr double kShortArmPx = 5;       ///< for a second try where the longer arms do not fit

struct SaddleFit {
  Vec2 px;
  double sigma_px = 0;  ///< standard error of each coordinate (root of the mean variance)
  double contrast =
      0;  ///< half the step between the fields; > 0: bright where both board offsets have one sign
  double blur_px = 0;                         ///< Gaussian, lens and pixel together
  double misfit = 0;                          ///< RMS of what the model leaves [grey levels]
  std::array<double, kSaddleParams> state{};  ///< of the model (kSaddleParams), for another fit
};

/// nullopt: no corner there (the fit runs away or its edges are not as J says, the model leaves too
/// much, fewer than half of the window's pixels are in the image). `noise`: of the image
/// [grey levels]; where the model leaves more than that, sigma grows with it. `before`: a fit of the same
/// corner with another window, to begin with (may be null).
std::optional<SaddleFit> fit_saddle(const cv::Mat& grey, const Vec2& start, const SaddleWindow& window,
                                    double noise, const SaddleFit* before = nullptr);

}  // namespace plumbline::detail
