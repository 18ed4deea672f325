// SPDX-License-Identifier: Apache-2.0
#include "page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <optional>

#include "plumbline/core/text.hpp"

namespace plumbline::detail {
namespace {

struct Named {
  std::string_view name;
  double width_mm, height_mm;
};
// ISO 216, from small to large, and ANSI A.
constexpr std::array<Named, 5> kIso{
    {{"A4", 210, 297}, {"A3", 297, 420}, {"A2", 420, 594}, {"A1", 594, 841}, {"A0", 841, 1189}}};
constexpr Named kLetter{"letter", 215.9, 279.4};

Error bad(const std::string& message) { return {ErrorCode::kInvalidData, message, "page"}; }

bool equal_ignoring_case(std::string_view a, std::string_view b) {
  const auto same = [](unsigned char x, unsigned char y) { return std::tolower(x) == std::tolower(y); };
  return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), same);
}

// "300x500mm"
std::optional<Page> parse_size(std::string_view text) {
  if (!text.ends_with("mm")) return std::nullopt;
  const auto sides = split(text.substr(0, text.size() - 2), 'x');
  if (sides.size() != 2) return std::nullopt;
  const auto width = parse_double(sides[0]), height = parse_double(sides[1]);
  if (!width || !height || !(*width >= 20 && *width <= 5000) || !(*height >= 20 && *height <= 5000))
    return std::nullopt;
  return Page{std::string(text), Vec2(*width, *height)};
}

// As it is, or turned; nullopt when the board fits neither way.
std::optional<Page> fit(const Page& page, const Vec2& needed_mm) {
  const Vec2 room = page.size_mm - Vec2::Constant(2 * kPageBorderMm - 1e-6);
  if ((needed_mm.array() <= room.array()).all()) return page;
  if (needed_mm.x() > room.y() || needed_mm.y() > room.x()) return std::nullopt;
  const bool upright = page.size_mm.x() <= page.size_mm.y();
  return Page{page.name + (upright ? " landscape" : " portrait"), Vec2(page.size_mm.y(), page.size_mm.x())};
}

std::optional<Page> smallest_iso(const Vec2& needed_mm) {
  for (const Named& iso : kIso) {
    if (auto page = fit({std::string(iso.name), Vec2(iso.width_mm, iso.height_mm)}, needed_mm)) return page;
  }
  return std::nullopt;
}

}  // namespace

Result<Page> choose_page(std::string_view wanted, const Vec2& needed_mm) {
  const Vec2 whole = needed_mm + Vec2::Constant(2 * kPageBorderMm);
  const std::string own = fmt::format("{:.0f}x{:.0f}mm", std::ceil(whole.x()), std::ceil(whole.y()));
  const auto larger = smallest_iso(needed_mm);
  if (equal_ignoring_case(wanted, "auto")) {
    if (larger) return *larger;
    return bad(fmt::format(
        "the board needs {:.1f} x {:.1f} mm with a border of {:.0f} mm, more than A0; give --page {}",
        whole.x(), whole.y(), kPageBorderMm, own));
  }
  std::optional<Page> page = parse_size(wanted);
  for (const Named& iso : kIso) {
    if (equal_ignoring_case(wanted, iso.name))
      page = Page{std::string(iso.name), Vec2(iso.width_mm, iso.height_mm)};
  }
  if (equal_ignoring_case(wanted, kLetter.name))
    page = Page{"letter", Vec2(kLetter.width_mm, kLetter.height_mm)};
  if (!page)
    return bad(
        fmt::format("'{}' is no page: A4, A3, A2, A1, A0, letter, or WxHmm from 20 to 5000 mm", wanted));
  if (auto fitted = fit(*page, needed_mm)) return *fitted;
  return bad(fmt::format(
      "the board needs {:.1f} x {:.1f} mm with a border of {:.0f} mm and does not fit {} ({:g} x {:g} mm); "
      "the next page that fits: --page {}",
      whole.x(), whole.y(), kPageBorderMm, page->name, page->size_mm.x(), page->size_mm.y(),
      larger ? larger->name.substr(0, larger->name.find(' ')) : own));
}

}  // namespace plumbline::detail
