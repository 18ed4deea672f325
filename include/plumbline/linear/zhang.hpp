// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

namespace plumbline {

/// K without skew from n >= 2 homographies board -> pixels (n >= 3 recommended): Zhang, "A flexible new
/// technique for camera calibration" (2000), with the constraints of the image of the absolute conic
/// normalised to the image size. \returns kDegenerate when the views do not constrain K: all boards parallel
/// to one another or to the image, or the
///          conic is not positive definite; the message has the ratio of the singular values
Result<Mat3> zhang_k(std::span<const Mat3> H_px_board, ImageSize size);

/// Focal length alone [px] (fx = fy, centre in the middle of the image) from n >= 1 homographies: the robust
/// fallback.
Result<double> zhang_focal(std::span<const Mat3> H_px_board, ImageSize size);

}  // namespace plumbline
