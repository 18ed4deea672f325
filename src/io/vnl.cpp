// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "io/dataset_yaml.hpp"
#include "plumbline/core/check.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/io/dataset_io.hpp"

namespace plumbline {
namespace {

using Words = std::vector<std::string_view>;

Error bad_line(int line, const std::string& message) {
  return {ErrorCode::kParse, message, fmt::format("line {}", line)};
}

/// Where the columns are, from the legend "# filename x y level".
struct Columns {
  std::size_t n = 0, filename = 0, x = 0, y = 0;
  std::optional<std::size_t> level, weight;
};

Result<Columns> read_legend(const Words& words, int line) {
  Columns columns;
  columns.n = words.size();
  const auto find = [&](std::string_view name) -> std::optional<std::size_t> {
    const auto at = std::find(words.begin(), words.end(), name);
    if (at == words.end()) return std::nullopt;
    return static_cast<std::size_t>(at - words.begin());
  };
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (std::count(words.begin(), words.end(), words[i]) > 1) {
      return bad_line(line, fmt::format("the legend has the column '{}' twice", words[i].substr(0, 40)));
    }
  }
  const auto filename = find("filename"), x = find("x"), y = find("y");
  if (!filename || !x || !y) return bad_line(line, "the legend needs the columns filename, x and y");
  columns.filename = *filename;
  columns.x = *x;
  columns.y = *y;
  columns.level = find("level");
  columns.weight = find("weight");
  if (columns.level && columns.weight)
    return bad_line(line, "the legend has both level and weight; one is needed");
  return columns;
}

/// The corner of a row, or nullopt where the point was not seen. As mrcal reads them: '-' or a negative
/// pixel, a negative level, a weight that is not positive.
Result<std::optional<Corner>> read_row(const Words& words, const Columns& columns, int line) {
  if (words.size() != columns.n) {
    return bad_line(line, fmt::format("{} columns are needed, there are {}", columns.n, words.size()));
  }
  std::optional<Corner> absent;
  const auto extra = columns.level ? columns.level : columns.weight;
  const std::string_view x = words[columns.x], y = words[columns.y];
  if (x == "-" || y == "-" || (extra && words[*extra] == "-")) return absent;
  const auto px = parse_double(x), py = parse_double(y);
  if (!px || !py)
    return bad_line(line, fmt::format("a pixel is needed, not '{} {}'", x.substr(0, 40), y.substr(0, 40)));
  Corner corner;
  corner.px = {*px, *py};
  if (extra) {
    const auto value = parse_double(words[*extra]);
    if (!value)
      return bad_line(line, fmt::format("a number is needed, not '{}'", words[*extra].substr(0, 40)));
    if (columns.level ? *value < 0 : *value <= 0) return absent;
    if (columns.level && *value > 30) return bad_line(line, fmt::format("level {} is above 30", *value));
    corner.sigma_px = columns.level ? std::exp2(std::floor(*value)) : 1 / *value;
    if (!std::isfinite(corner.sigma_px) || !(corner.sigma_px > 0)) {
      return bad_line(line, fmt::format("weight {} has no finite inverse", *value));
    }
  }
  if (*px < 0 || *py < 0) return absent;
  return std::optional(corner);
}

}  // namespace

Result<std::vector<VnlImage>> parse_vnl(std::string_view text) {
  std::vector<VnlImage> images;
  std::map<std::string, std::size_t, std::less<>> index;
  std::optional<Columns> columns;
  std::optional<Error> failed;
  io::for_each_row(text, [&](int line, Words& words) {
    if (failed || words[0].substr(0, 2) == "##" || words[0].substr(0, 2) == "#!") return;
    if (words[0].front() == '#') {
      if (columns) return;  // the first one is the legend, later ones are remarks
      words[0].remove_prefix(1);
      if (words[0].empty()) words.erase(words.begin());
      auto legend = read_legend(words, line);
      if (legend)
        columns = *legend;
      else
        failed = legend.error();
      return;
    }
    if (!columns) {
      failed = bad_line(line, "a legend '# filename x y level' is needed before the first row");
      return;
    }
    auto corner = read_row(words, *columns, line);
    if (!corner) {
      failed = corner.error();
      return;
    }
    const std::string_view name = words[columns->filename];
    auto place = index.find(name);
    if (place == index.end()) {
      place = index.emplace(std::string(name), images.size()).first;
      images.push_back({std::string(name), {}, 0});
    }
    const int point = images[place->second].n_rows++;
    if (!*corner) return;
    (*corner)->point = point;
    images[place->second].corners.push_back(**corner);
  });
  if (failed) return *failed;
  if (!text.empty() && !text.ends_with('\n')) {
    return Error{ErrorCode::kParse, "the last line does not end; the file seems to be cut off", "the end"};
  }
  if (!columns)
    return Error{ErrorCode::kParse, "not a corners.vnl: it has no legend '# filename x y level'", ""};
  return images;
}

std::string format_vnl(const Dataset& data, int cam) {
  PLUMBLINE_CHECK(cam >= 0 && cam < static_cast<int>(data.cameras.size()), "no such camera");
  // A level says how much coarser than the finest a corner is, in powers of two.
  double finest_px = 1;
  for (const View& view : data.views) {
    if (view.cam != cam) continue;
    for (const Corner& corner : view.corners) finest_px = std::min(finest_px, corner.sigma_px);
  }
  std::string out = "# filename x y level\n";
  for (const View& view : data.views) {
    if (view.cam != cam) continue;
    std::string name = view.image;
    std::replace_if(
        name.begin(), name.end(), [](unsigned char c) { return c <= ' '; }, '_');
    if (name.empty() || name.front() == '#') name = "_" + name;
    if (view.corners.empty()) {
      out += name + " - - -\n";
      continue;
    }
    auto corner = view.corners.begin();
    for (int point = 0; point < static_cast<int>(data.targets[0].points.size()); ++point) {
      if (corner == view.corners.end() || corner->point != point) {
        out += name + " - - -\n";
        continue;
      }
      const auto level = std::lround(std::log2(corner->sigma_px / finest_px));
      out += fmt::format("{} {} {} {}\n", name, io::number_text(corner->px.x()),
                         io::number_text(corner->px.y()), level);
      ++corner;
    }
  }
  return out;
}

}  // namespace plumbline
