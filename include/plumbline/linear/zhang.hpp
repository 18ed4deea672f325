// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

namespace plumbline {

/// K without skew from n >= 2 homographies board -> pixels (n >= 3 recommended): Zhang, "A flexible
/// new technique for camera calibration" (2000), with the constraints of the image of the absolute
/// conic normalised to the image size.
/// \param H_px_board  any scale and sign of each; fewer than 2 throw std::invalid_argument
/// \returns K [px]; kDegenerate when the views do not constrain K: all boards parallel to one another
///          or to the image (their vanishing lines do not differ by 10 times their noise), the conic
///          is not positive definite, or its uncertainty is over half of the focal length; the
///          message has the number. kInvalidData for NaN
Result<Mat3> zhang_k(std::span<const Mat3> H_px_board, ImageSize size);

/// Focal length alone [px] (fx = fy, centre in the middle of the image) from n >= 1 homographies: the
/// robust fallback. Boards may be parallel to one another, not to the image. Under strong distortion
/// it is the steadier of the two.
/// \returns kDegenerate when f^2 comes out negative or f is uncertain by more than half (noise, and an
///          allowance of 1 % for pixels that are not square), as for boards parallel to the image;
///          kInvalidData for NaN
Result<double> zhang_focal(std::span<const Mat3> H_px_board, ImageSize size);

}  // namespace plumbline
