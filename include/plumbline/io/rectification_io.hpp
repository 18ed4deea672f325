// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "plumbline/rectify/rectify.hpp"
#include "plumbline/rig/rig.hpp"

namespace plumbline {

/// rectification.yaml: OpenCV FileStorage with image size, R1 R2 P1 P2 Q.
std::string format_rectification(const StereoRectification& rectification);

/// The pinhole cameras of undistorted images, as a camera file that read_rig reads back.
std::string format_undistorted(const Rig& rig);

}  // namespace plumbline
