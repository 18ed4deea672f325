// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/points_io.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <set>

#include "io/yaml.hpp"
#include "plumbline/core/check.hpp"
#include "plumbline/core/text.hpp"

namespace plumbline {
namespace {

constexpr std::size_t kMaxBytes = std::size_t{64} << 20;
constexpr std::size_t kMaxColumns = 1000, kMaxValues = 10'000'000;

using Words = std::vector<std::string_view>;

Error at_line(int line, const std::string& message) {
  return {ErrorCode::kParse, message, fmt::format("line {}", line)};
}

std::string shown(std::string_view text) { return std::string(text.substr(0, 40)); }

bool is_name(std::string_view word) {
  if (word.empty() || word.size() > 100) return false;
  const auto letter = [](unsigned char c) { return std::isalpha(c) || c == '_'; };
  return letter(word.front()) && std::all_of(word.begin(), word.end(), [&](unsigned char c) {
           return letter(c) || std::isdigit(c) || c == '.';
         });
}

// Cells between commas, or words between blanks; `words` is used again from line to line.
void split_cells(std::string_view line, bool commas, Words& words) {
  words.clear();
  if (trim(line).empty()) return;
  if (commas) {
    for (;;) {
      const auto comma = line.find(',');
      words.push_back(trim(line.substr(0, comma)));
      if (comma == std::string_view::npos) return;
      line.remove_prefix(comma + 1);
    }
  }
  for (;;) {
    const auto first = line.find_first_not_of(" \t\r");
    if (first == std::string_view::npos) return;
    line.remove_prefix(first);
    const auto last = line.find_first_of(" \t\r");
    words.push_back(line.substr(0, last));
    line.remove_prefix(last == std::string_view::npos ? line.size() : last);
  }
}

std::string_view unquoted(std::string_view word) {
  const bool quoted = word.size() >= 2 && word.front() == '"' && word.back() == '"';
  return quoted ? word.substr(1, word.size() - 2) : word;
}

// Whether every cell could be a column's name.
bool is_header(const Words& words) {
  return !words.empty() &&
         std::all_of(words.begin(), words.end(), [](std::string_view w) { return is_name(unquoted(w)); });
}

// The value of a cell: a number, NaN for '-', nullopt for anything else.
std::optional<double> cell_value(std::string_view cell) {
  if (cell == "-") return std::numeric_limits<double>::quiet_NaN();
  return parse_double(cell);
}

Status set_columns(PointTable& table, const Words& names, int line) {
  if (names.size() > kMaxColumns)
    return at_line(line, fmt::format("{} columns; at most {} are read", names.size(), kMaxColumns));
  std::set<std::string_view> seen;
  for (std::string_view word : names) {
    const std::string_view name = unquoted(word);
    if (!is_name(name)) {
      return at_line(line, fmt::format("'{}' is no name of a column; a header such as X,Y,Z,u,v is needed",
                                       shown(name)));
    }
    if (!seen.insert(name).second) return at_line(line, fmt::format("two columns are named '{}'", name));
    table.columns.emplace_back(name);
  }
  table.values.resize(names.size());
  return {};
}

Status add_row(PointTable& table, const Words& cells, int line) {
  if (cells.size() != table.columns.size()) {
    return at_line(line, fmt::format("{} values for the {} columns {}", cells.size(), table.columns.size(),
                                     shown(join(table.columns, ", "))));
  }
  if ((table.n_rows() + 1) * table.columns.size() > kMaxValues)
    return at_line(line, fmt::format("more than {} values; split the file", kMaxValues));
  for (std::size_t c = 0; c < cells.size(); ++c) {
    const auto value = cell_value(cells[c]);
    if (!value) {
      return at_line(line, fmt::format("{} is '{}'; a finite number is needed, or '-' where it is not known",
                                       table.columns[c], shown(cells[c])));
    }
    table.values[c].push_back(*value);
  }
  table.lines.push_back(line);
  return {};
}

// Rows of text, `first_line` being the line of the first of them in the file.
class RowReader {
 public:
  /// `commas` matters where the table has its columns already.
  explicit RowReader(PointTable& table, bool commas = false) : table_(table), commas_(commas) {}

  Status read(std::string_view text, int first_line) {
    for (int line = first_line; !text.empty(); ++line) {
      const auto end = text.find('\n');
      std::string_view row = text.substr(0, end);
      text = end == std::string_view::npos ? std::string_view{} : text.substr(end + 1);
      if (Status s = read_line(row, line); !s) return s;
    }
    return {};
  }

 private:
  Status read_line(std::string_view row, int line) {
    const auto hash = row.find('#');
    const std::string_view remark = hash == std::string_view::npos ? "" : row.substr(hash + 1);
    row = row.substr(0, hash);
    if (trim(row).empty()) {
      if (table_.columns.empty() && !trim(remark).empty()) remark_ = {remark, line};
      return {};
    }
    if (!table_.columns.empty()) {
      split_cells(row, commas_, words_);
      return add_row(table_, words_, line);
    }
    commas_ = row.find(',') != std::string_view::npos;
    split_cells(row, commas_, words_);
    if (cell_value(words_.front())) return headed_by_remark(line);
    return set_columns(table_, words_, line);
  }

  // The first row already holds numbers: the remark above it must name the columns.
  Status headed_by_remark(int line) {
    Words names;
    // savetxt's header is free text: it may have commas where the numbers have blanks.
    split_cells(remark_.text, remark_.text.find(',') != std::string_view::npos, names);
    if (!is_header(names) || names.size() != words_.size())
      return at_line(line, "numbers without a header; a first line such as X,Y,Z,u,v must name the columns");
    if (Status s = set_columns(table_, names, remark_.line); !s) return s;
    return add_row(table_, words_, line);
  }

  PointTable& table_;
  bool commas_;
  Words words_;
  struct {
    std::string_view text;
    int line = 0;
  } remark_;
};

Result<PointTable> from_yaml(const io::Field& root) {
  root.only({"columns", "rows"});
  PointTable table;
  std::vector<std::string> names;
  for (const io::Field& name : root.at("columns").items()) names.push_back(name.text());
  if (names.empty()) root.at("columns").fail("at least one column is needed");
  const Words words(names.begin(), names.end());
  if (Status s = set_columns(table, words, root.at("columns").line()); !s) return s.error();
  const io::Field rows = root.at("rows");
  if (!rows.is_sequence()) {
    // A block's first line is the one below its key.
    const std::string block = rows.text();
    const bool commas = block.find(',') != std::string::npos;
    if (Status s = RowReader(table, commas).read(block, rows.line() + 1); !s) return s.error();
    return table;
  }
  for (const io::Field& row : rows.items()) {
    std::vector<std::string> texts;
    for (const io::Field& cell : row.items()) texts.push_back(cell.is_null() ? "-" : cell.text());
    if (Status s = add_row(table, Words(texts.begin(), texts.end()), row.line()); !s) return s.error();
  }
  return table;
}

// YAML has a colon or a brace in its first line that is no remark; the header and the rows of a CSV never do.
bool looks_like_yaml(std::string_view text) {
  while (!text.empty()) {
    const auto end = text.find('\n');
    const std::string_view line = trim(text.substr(0, end));
    text = end == std::string_view::npos ? std::string_view{} : text.substr(end + 1);
    if (line.empty() || line.front() == '#') continue;
    return line.find_first_of(":{%") != std::string_view::npos || line == "---";
  }
  return false;
}

Result<std::vector<const std::vector<double>*>> find_all(const PointTable& table,
                                                         std::initializer_list<std::string_view> names) {
  std::vector<const std::vector<double>*> columns;
  for (std::string_view name : names) {
    const auto at = table.find(name);
    if (!at) {
      return Error{ErrorCode::kInvalidData,
                   fmt::format("the column '{}' is missing; there are {} (capitals count)", name,
                               join(table.columns, ", ")),
                   ""};
    }
    columns.push_back(&table.values[*at]);
  }
  return columns;
}

template <int N>
Result<std::vector<Eigen::Matrix<double, N, 1>>> points(const PointTable& table,
                                                        std::initializer_list<std::string_view> names) {
  auto columns = find_all(table, names);
  if (!columns) return columns.error();
  std::vector<Eigen::Matrix<double, N, 1>> out(table.n_rows());
  for (std::size_t r = 0; r < out.size(); ++r) {
    for (int i = 0; i < N; ++i) out[r][i] = (*(*columns)[i])[r];
    if (!out[r].allFinite()) {
      return Error{ErrorCode::kInvalidData, "a value of this row is '-', and all are needed here",
                   fmt::format("line {}", table.lines[r])};
    }
  }
  return out;
}

}  // namespace

std::optional<std::size_t> PointTable::find(std::string_view column) const {
  const auto at = std::find(columns.begin(), columns.end(), column);
  if (at == columns.end()) return std::nullopt;
  return static_cast<std::size_t>(at - columns.begin());
}

Result<PointTable> parse_points(std::string_view text) {
  if (text.size() > kMaxBytes) {
    return Error{ErrorCode::kParse,
                 fmt::format("{} MiB of text; at most {} are read; split the file", text.size() >> 20,
                             kMaxBytes >> 20),
                 ""};
  }
  if (const auto zero = text.find('\0'); zero != std::string_view::npos) {
    return at_line(1 + static_cast<int>(std::count(text.begin(), text.begin() + zero, '\n')),
                   "a zero byte: this is no text");
  }
  // Spreadsheets write a byte-order mark.
  if (text.substr(0, 3) == "\xEF\xBB\xBF") text.remove_prefix(3);
  PointTable table;
  if (looks_like_yaml(text)) {
    auto read = io::read_yaml<PointTable>(text, "", from_yaml);
    if (!read) return read;
    table = *std::move(read);
  } else if (Status s = RowReader(table).read(text, 1); !s) {
    return s.error();
  }
  if (table.n_rows() == 0) {
    return Error{ErrorCode::kParse,
                 table.columns.empty()
                     ? "no header and no rows; a first line such as X,Y,Z,u,v must name the columns"
                     : "a header and no rows",
                 ""};
  }
  return table;
}

std::string format_points(const PointTable& table) {
  PLUMBLINE_CHECK(table.values.size() == table.columns.size(), "values for each column are needed");
  std::string text = join(table.columns, ",") + "\n";
  for (std::size_t r = 0; r < table.n_rows(); ++r) {
    for (std::size_t c = 0; c < table.columns.size(); ++c) {
      const double value = table.values[c].at(r);
      text += (c ? "," : "") + (std::isnan(value) ? std::string("-") : io::number_text(value));
    }
    text += "\n";
  }
  return text;
}

Result<std::vector<Vec2>> points_2d(const PointTable& table, std::string_view u, std::string_view v) {
  return points<2>(table, {u, v});
}

Result<std::vector<Vec3>> points_3d(const PointTable& table, std::string_view x, std::string_view y,
                                    std::string_view z) {
  return points<3>(table, {x, y, z});
}

Result<std::vector<std::optional<Vec2>>> seen_points_2d(const PointTable& table, std::string_view u,
                                                        std::string_view v) {
  auto columns = find_all(table, {u, v});
  if (!columns) return columns.error();
  std::vector<std::optional<Vec2>> out(table.n_rows());
  for (std::size_t r = 0; r < out.size(); ++r) {
    const Vec2 px((*(*columns)[0])[r], (*(*columns)[1])[r]);
    if (px.allFinite()) out[r] = px;
  }
  return out;
}

}  // namespace plumbline
