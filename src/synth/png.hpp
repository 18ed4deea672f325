// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

namespace plumbline::detail {

/// The PNG file with its resolution (chunk pHYs, pixels per metre) set, which cairo does not write.
std::string png_with_dpi(const std::string& png, int dpi);

}  // namespace plumbline::detail
