// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

namespace plumbline {

/// What is done with the shear and the stretch along the rows, which the matching of rows leaves free.
enum class RowFreedom {
  kLeastDistortion,  ///< both images keep their shape as far as possible, and their centres the middle
  kLeastDisparity    ///< the first image is fitted to the second along the rows (Hartley's H_A): a plane that
                     ///< all points lie near comes out with disparity 0, and the mean disparity is 0
};

struct UncalibratedOptions {
  RowFreedom rows = RowFreedom::kLeastDistortion;
};

/// Two homographies after which corresponding points have the same row.
struct UncalibratedRectification {
  std::array<Mat3, 2> H;  ///< px_rect ~ H[i] px of image i; the third coordinate is > 0 all over the image
                          ///< and 1 at its centre, det > 0: no image is mirrored
  bool vertical = false;  ///< the epipoles lie above or below: columns match, not rows
  /// How far each image is from its own shape: root mean square over the image of s - 1, s the two local
  /// stretches (the singular values of the Jacobian of H); 0 for a rotation.
  std::array<double, 2> distortion{};
  double row_rms_px = 0;  ///< root mean square of the difference of rows over the given points [px]
  double min_disparity_px = 0, max_disparity_px = 0;  ///< x1 - x2 of the given points (y1 - y2 if vertical)
};

/// Rectification of two views without calibration: Hartley, "Theory and practice of projective rectification"
/// (1999), Hartley & Zisserman (2004), section 11.12, with both epipoles sent to infinity along the rows. Of
/// all pairs of homographies that match the rows (F ~ w2 v1' - v2 w1' for the second and third rows v, w of
/// H1, H2) the one with the least distortion is taken, the measure being that of Gluckman & Nayar (2001) over
/// both images: the local stretches' squared distances from 1. The first image's up stays up, and both
/// pictures turn by the least that does it; the rectified images have the size of the originals.
/// \param F  [px2; 1]' F [px1; 1] = 0, any scale; made singular if it is not
/// \param px1, px2  n >= 0 corresponding points, which are measured, and which kLeastDisparity fits; unequal
///        numbers throw std::invalid_argument
/// \returns kDegenerate: an epipole inside its image, or so near that no line through it and its partner miss
///          both images (a camera that moved along its axis: a polar
///          rectification is needed); F of rank below 2; with kLeastDisparity points whose columns do not
///          determine the fit (fewer than 3, or on a line). kInvalidData for NaN and a size without area
Result<UncalibratedRectification> rectify_uncalibrated(const Mat3& F, std::span<const Vec2> px1,
                                                       std::span<const Vec2> px2, ImageSize size,
                                                       const UncalibratedOptions& options = {});

/// The measure of `distortion` for any homography and image: root mean square over a grid of s - 1.
double homography_distortion(const Mat3& H, ImageSize size);

}  // namespace plumbline
