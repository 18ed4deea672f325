// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "plumbline/linear/camera_matrix.hpp"

/// What the roads from P to K and R share. Private to the module.
namespace plumbline::detail {

/// P or -P, the one with det M > 0 of its left 3x3 block M: K R has a positive determinant. kDegenerate when
/// M is singular.
Result<Mat34> with_positive_determinant(const Mat34& P);

/// The parts of P = U [R | t] with det M > 0, for U upper triangular with a positive diagonal.
CameraMatrixParts parts_of(const Mat34& P, const Mat3& U, const Mat3& R);

}  // namespace plumbline::detail
