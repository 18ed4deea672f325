// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string_view>

#include "plumbline/core/result.hpp"
#include "plumbline/geometry/se3.hpp"

namespace plumbline {

/// A rigid transform from text. Either 9 (R), 12 (3x4) or 16 (4x4) numbers, row by row, and nothing else; or
/// YAML or JSON with `T` (12 or 16 numbers, also as a list of rows), or with a rotation, one of `R`,
/// `quaternion_wxyz`, `rotation_rad`, `rvec_rad` (the identity where there is none), and a translation, `t`
/// or `translation_m` (zero where there is none). Other keys are passed over, so that the answers of
/// `plumbline geometry` can be read.
/// \returns kParse with the field and its line; kInvalidData where the numbers are no rigid transform: R'R
///          off the identity by 1e-5 or more, det R < 0, a last row that is not 0 0 0 1, a quaternion whose
///          length is off 1 by 1e-4
Result<SE3> parse_transform(std::string_view text);

/// R and t as a transform; kInvalidData with the numbers where R is no rotation to 1e-5.
Result<SE3> rigid_transform(const Mat3& R, const Vec3& t_m);

/// [w x y z] as a rotation; kInvalidData where its length is off 1 by 1e-4.
Result<Mat3> rotation_of_quaternion(const Vec4& wxyz);

}  // namespace plumbline
