// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/yaml.hpp"
#include "plumbline/io/formats.hpp"

/// What the formats share. Each format is one file that defines its constant; formats.cpp holds the table.
namespace plumbline::io {

extern const Format kNativeFormat, kOpencvFormat, kRosFormat, kKalibrFormat, kMrcalFormat, kColmapFormat;

/// kUnsupported: names the lens, the camera, what the format can express and who can express the lens.
Error unsupported_lens(const Format& format, const Camera& camera);

/// kUnsupported where poses_known() is false, for writers whose files need poses: identities would be false
/// ones.
Status check_poses(const Format& format, const Rig& rig);

/// Names of files for the cameras: their names without what a file name cannot hold, made distinct.
std::vector<std::string> file_stems(const Rig& rig);
/// "left" of "some/where/left.yaml".
std::string stem_of(const std::string& file);

/// k1 k2 p1 p2 k3 ... of a pinhole (none) or a Brown-Conrady lens, nullopt for any other.
std::optional<std::vector<double>> brown_coefficients(const Lens& lens);
/// The same filled up with zeros or cut to n; nullopt where a number other than zero would be cut off.
std::optional<std::vector<double>> brown_coefficients(const Lens& lens, std::size_t n);

/// fx fy cx cy, then the coefficients of a lens of that name.
Lens lens_of(const Field& field, std::string_view name, const std::vector<double>& k4,
             const std::vector<double>& d);
/// The Brown-Conrady lens with 4, 5, 8, 12 or (tilt zero) 14 coefficients; a pinhole where they are none or
/// all zero.
Lens brown_lens(const Field& field, const std::vector<double>& k4, std::vector<double> d);
/// fx fy cx cy of [fx 0 cx; 0 fy cy; 0 0 1]; kUnsupported when there is skew.
std::vector<double> focal_and_centre(const Field& matrix, const std::vector<double>& k9);
ImageSize size_of(const Field& width, const Field& height);

/// A rotation (9 numbers row by row) and a translation; made an exact rotation where it is one to 1e-3.
SE3 pose_of(const Field& field, const std::vector<double>& R, const std::vector<double>& t);
/// A 4x4 matrix.
SE3 pose_of(const Field& matrix);
/// All poses relative to the first camera, so that T_cam_rig[0] is the identity.
void make_first_the_rig(Rig& rig);

/// T_second_first of two cameras of the rig.
SE3 relative_pose(const Rig& rig, int first, int second);

}  // namespace plumbline::io
