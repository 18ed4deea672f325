// SPDX-License-Identifier: Apache-2.0
#include "stroke_font.hpp"

#include <cctype>
#include <map>

namespace plumbline::detail {
namespace {

// Points "xy" on a grid 4 wide: y = 0 is the top of a tall letter, 2 that of a small one, 6 the foot, 8 the
// depth. A comma lifts the pen.
const std::map<char, std::string_view>& glyphs() {
  static const std::map<char, std::string_view> table{
      {'0', "10 30 41 45 36 16 05 01 10"},
      {'1', "11 20 26"},
      {'2', "01 10 30 41 42 06 46"},
      {'3', "00 40 22 33 44 45 36 16 05"},
      {'4', "36 30 04 44"},
      {'5', "40 00 02 32 43 45 36 16 05"},
      {'6', "30 10 01 05 16 36 45 43 32 02"},
      {'7', "00 40 16"},
      {'8', "13 02 01 10 30 41 42 33 13 04 05 16 36 45 44 33"},
      {'9', "16 36 45 41 30 10 01 02 13 43"},
      {'a', "12 32 43 46 16 05 14 44"},
      {'b', "00 06 36 45 43 32 02"},
      {'c', "42 12 03 05 16 46"},
      {'d', "40 46 16 05 03 12 42"},
      {'e', "04 44 43 32 12 03 05 16 46"},
      {'f', "40 30 21 26,02 42"},
      {'g', "42 12 03 05 16 46,42 47 38 08"},
      {'h', "00 06,03 12 32 43 46"},
      {'i', "22 26,20 21"},
      {'j', "32 37 28 18,30 31"},
      {'k', "00 06,42 04 46"},
      {'l', "10 15 26"},
      {'m', "06 02 12 23 26,23 32 43 46"},
      {'n', "06 02,03 12 32 43 46"},
      {'o', "12 32 43 45 36 16 05 03 12"},
      {'p', "08 02 32 43 45 36 06"},
      {'q', "48 42 12 03 05 16 46"},
      {'r', "06 02,03 12 42"},
      {'s', "42 12 03 14 34 45 36 06"},
      {'t', "20 25 36 46,02 42"},
      {'u', "02 05 16 46,42 46"},
      {'v', "02 26 42"},
      {'w', "02 16 24 36 42"},
      {'x', "02 46,42 06"},
      {'y', "02 05 16 46,42 47 38 08"},
      {'z', "02 42 06 46"},
      {'_', "07 47"},
      {'-', "14 34"},
      {'.', "25 26"},
      {',', "25 26 17"},
      {':', "22 23,25 26"},
      {'/', "40 06"},
      {'(', "30 21 25 36"},
      {')', "10 21 25 16"},
  };
  return table;
}

constexpr double kAdvance = 6;  // grid units from one character to the next

}  // namespace

std::vector<std::vector<Vec2>> text_strokes(std::string_view text, double height) {
  std::vector<std::vector<Vec2>> strokes;
  const double unit = height / 6;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto glyph = glyphs().find(static_cast<char>(std::tolower(static_cast<unsigned char>(text[i]))));
    if (glyph == glyphs().end()) continue;
    strokes.emplace_back();
    for (std::size_t k = 0; k + 1 < glyph->second.size(); k += 3) {
      strokes.back().emplace_back(unit * (kAdvance * static_cast<double>(i) + (glyph->second[k] - '0')),
                                  unit * (glyph->second[k + 1] - '6'));
      if (k + 2 < glyph->second.size() && glyph->second[k + 2] == ',') strokes.emplace_back();
    }
  }
  return strokes;
}

double text_width(std::string_view text, double height) {
  return text.empty() ? 0 : (kAdvance * static_cast<double>(text.size()) - 2) * height / 6;
}

}  // namespace plumbline::detail
