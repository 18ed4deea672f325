// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "plumbline/rectify/rectify.hpp"

namespace plumbline {

/// rectification.yaml: OpenCV FileStorage with image size, R1 R2 P1 P2 Q.
std::string format_rectification(const StereoRectification& rectification);

}  // namespace plumbline
