// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "io/yaml.hpp"
#include "plumbline/target/target.hpp"

/// Pieces of target files that corners.yaml and calibration.yaml hold too.
namespace plumbline::io {

/// {rotation_rad: [x, y, z], translation_m: [x, y, z]} with a rotation vector, or {quaternion_wxyz: [w, x, y,
/// z], translation_m: ...}, which pose_text() writes because it gives the same SE3 back to the last bit.
SE3 read_pose(const Field& field);
std::string pose_text(const SE3& T);

/// The keys of a target within a map of their own.
Target read_target(const Field& field);
void write_target(std::string& out, const std::string& indent, const Target& target);

}  // namespace plumbline::io
