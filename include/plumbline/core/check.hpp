// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

namespace plumbline {
/// Throws std::invalid_argument(text). Out of line, so that headers need not include <stdexcept>.
[[noreturn]] void throw_invalid_argument(const std::string& text);
}  // namespace plumbline

/// A caller broke a precondition: throws std::invalid_argument, always on, at API boundaries only.
#define PLUMBLINE_CHECK(condition, text)                                                            \
  do {                                                                                              \
    if (!(condition)) ::plumbline::throw_invalid_argument(std::string(text) + " (" #condition ")"); \
  } while (false)
