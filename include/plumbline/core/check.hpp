// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <string_view>

namespace plumbline {
/// Throws std::invalid_argument(text). Out of line, so that headers need not include <stdexcept>.
[[noreturn]] void throw_invalid_argument(const std::string& text);

/// Throws std::invalid_argument("text (condition)").
[[noreturn]] void throw_failed_check(std::string_view text, std::string_view condition);
}  // namespace plumbline

/// A caller broke a precondition: throws std::invalid_argument, always on, at API boundaries only.
#define PLUMBLINE_CHECK(condition, text)                                 \
  do {                                                                   \
    if (!(condition)) ::plumbline::throw_failed_check(text, #condition); \
  } while (false)
