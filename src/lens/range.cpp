// SPDX-License-Identifier: Apache-2.0
#include "plumbline/lens/range.hpp"

#include <fmt/format.h>

namespace plumbline {
namespace {

struct Range {
  bool holds = true;
  std::string_view text = "";
};

template <class L>
Range range_of(const L&) {
  return {};
}
Range range_of(const UnifiedCamera& l) { return {l.alpha >= 0 && l.alpha < 1, "0 <= alpha < 1"}; }
Range range_of(const EnhancedUnifiedCamera& l) {
  return {l.alpha >= 0 && l.alpha <= 1 && l.beta > 0, "0 <= alpha <= 1 and beta > 0"};
}
Range range_of(const DoubleSphere& l) { return {l.alpha >= 0 && l.alpha <= 1, "0 <= alpha <= 1"}; }

}  // namespace

std::string out_of_range(const Lens& lens) {
  const Range range = std::visit([](const auto& l) { return range_of(l); }, lens);
  if (range.holds) return "";
  const auto names = param_names(lens);
  std::string values;
  for (std::size_t i = 4; i < names.size(); ++i)
    values += fmt::format("{}{} = {:.4g}", i > 4 ? ", " : "", names[i], params(lens)[i]);
  return fmt::format("{}: {} is used with {}", values, lens_name(lens), range.text);
}

}  // namespace plumbline
