// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rig/rig.hpp"

namespace plumbline {

std::optional<int> Rig::find(std::string_view name) const {
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    if (cameras[i].name == name) return static_cast<int>(i);
  }
  return std::nullopt;
}

}  // namespace plumbline
