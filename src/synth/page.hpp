// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <string_view>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

namespace plumbline::detail {

/// A page of paper [mm].
struct Page {
  std::string name;  ///< "A4", "A4 landscape"
  Vec2 size_mm;
};

constexpr double kPageBorderMm = 5;  ///< what printers leave white

/// The page for a board of `needed_mm` (without border): `wanted` is A4..A0, letter, WxHmm or auto. Turned to
/// landscape when the board fits only so. kInvalidData as print_target says.
Result<Page> choose_page(std::string_view wanted, const Vec2& needed_mm);

}  // namespace plumbline::detail
