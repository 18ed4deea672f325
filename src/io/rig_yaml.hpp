// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "io/yaml.hpp"
#include "plumbline/rig/rig.hpp"

/// The part of calibration.yaml that is the rig: the keys `cameras` and `T_cam_rig`.
namespace plumbline::io {

Camera read_camera(const Field& field);
Rig read_rig_fields(const Field& root);
void write_rig_fields(std::string& out, const Rig& rig);

}  // namespace plumbline::io
