// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace plumbline {

/// 17 significant digits: the text parses back to the same double. NaN and infinity give "nan", "inf".
std::string format_double(double value);

/// The whole of `text` as a finite double or nullopt ("1.5 ", "nan", "1e999" and "" are nullopt). One sign, +
/// or -, may stand in front; the decimal point is a point whatever the locale.
std::optional<double> parse_double(std::string_view text);

/// The whole of `text` as an int or nullopt; one sign may stand in front.
std::optional<int> parse_int(std::string_view text);

/// Natural order: runs of digits compare as numbers, so that "img2" comes before "img10".
bool natural_less(std::string_view a, std::string_view b);

/// Pieces between `separator`s; "a,,b" gives three pieces, "" gives one empty piece.
std::vector<std::string> split(std::string_view text, char separator);

/// Without white space at both ends.
std::string_view trim(std::string_view text);

/// a, b, c joined by `separator`.
std::string join(const std::vector<std::string>& pieces, std::string_view separator);

}  // namespace plumbline
