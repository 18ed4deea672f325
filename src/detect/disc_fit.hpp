// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core/mat.hpp>
#include <optional>

#include "plumbline/core/types.hpp"

/// The centroid of the image of a dark disc on light paper, as disc_image() of detect/circle_bias.hpp
/// predicts it.
namespace plumbline::detail {

/// Where a disc is about, and which pixels around it are its own.
struct DiscWindow {
  Vec2 px;                 ///< its middle
  Mat2 J;                  ///< d px / d board
  double radius = 0;       ///< [board units of J]
  double reach_px = 0;     ///< beyond the outline, up to which the paper is clean
  double max_move_px = 3;  ///< of the middle, from the start
};

struct DiscFit {
  Vec2 centroid;
  double sigma_px = 0;  ///< standard error of each coordinate (root of the mean variance)
  double area_px2 = 0;
  double contrast = 0;  ///< grey levels between paper and ink
  double blur_px = 0;   ///< Gaussian, lens and pixel together
};

/// The mean place of the ink, where a pixel counts by how dark it is between paper and ink: a blurred edge
/// keeps its first moment, so neither blur nor sampling moves it. Pixels more than three blurs inside of the
/// outline count whole and those so far outside not at all, because they hold noise and no news; the light
/// may slope. sigma is what the image's noise (or what the paper and the ink leave, whichever is more) makes
/// of the sum. nullopt: less than 8 grey levels of contrast, no outline (a blob of another size), or one that
/// is not all in the image.
std::optional<DiscFit> fit_disc(const cv::Mat& grey, const DiscWindow& window, double noise);

/// How long the shortest image of a unit vector is: J's smaller singular value.
double least_stretch(const Mat2& J);

/// Area [px^2] and middle of the dark blob within `radius` px of `start`, whatever its size; for a first
/// estimate. Area 0: none.
struct DarkBlob {
  Vec2 centre = Vec2::Zero();
  double area_px2 = 0;
};
DarkBlob dark_blob(const cv::Mat& grey, const Vec2& start, double radius_px);

}  // namespace plumbline::detail
