// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/target_io.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tuple>

#include "io/target_yaml.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline {
namespace io {
namespace {

constexpr int kMaxInt = std::numeric_limits<int>::max();
constexpr std::array<std::string_view, 3> kLayouts{"auto", "current", "legacy"};

std::array<int, 2> two_counts(const Field& field) {
  const std::vector<Field> items = field.items();
  if (items.size() != 2)
    field.fail(fmt::format("two numbers are needed, [columns, rows], there are {}", items.size()));
  return {items[0].integer(1, 100000), items[1].integer(1, 100000)};
}

Chessboard read_chessboard(const Field& field) {
  field.only({"name", "type", "corners", "square_m"});
  const auto [columns, rows] = two_counts(field.at("corners"));
  return {columns, rows, field.at("square_m").number()};
}

Charuco read_charuco(const Field& field) {
  field.only({"name", "type", "squares", "square_m", "marker_m", "dictionary", "first_id", "layout"});
  Charuco board;
  std::tie(board.columns, board.rows) = std::tuple_cat(two_counts(field.at("squares")));
  board.square_m = field.at("square_m").number();
  board.marker_m = field.at("marker_m").number();
  board.dictionary = field.at("dictionary").text();
  if (const auto id = field.find("first_id")) board.first_id = id->integer(0, kMaxInt);
  if (const auto layout = field.find("layout")) {
    const auto found = std::find(kLayouts.begin(), kLayouts.end(), layout->text());
    if (found == kLayouts.end())
      layout->fail(fmt::format("'{}' is not one of: auto, current, legacy", layout->text()));
    board.layout = static_cast<Charuco::Layout>(found - kLayouts.begin());
  }
  return board;
}

AprilGrid read_aprilgrid(const Field& field) {
  field.only({"name", "type", "tags", "tag_m", "spacing", "family", "first_id", "border"});
  AprilGrid board;
  std::tie(board.columns, board.rows) = std::tuple_cat(two_counts(field.at("tags")));
  board.tag_m = field.at("tag_m").number();
  board.spacing = field.at("spacing").number();
  if (const auto family = field.find("family")) board.family = family->text();
  if (const auto id = field.find("first_id")) board.first_id = id->integer(0, kMaxInt);
  if (const auto border = field.find("border")) board.border = border->integer(1, 2);
  return board;
}

Circles read_circles(const Field& field) {
  field.only({"name", "type", "circles", "spacing_m", "diameter_m", "asymmetric"});
  Circles board;
  std::tie(board.columns, board.rows) = std::tuple_cat(two_counts(field.at("circles")));
  board.spacing_m = field.at("spacing_m").number();
  if (const auto diameter = field.find("diameter_m")) board.diameter_m = diameter->number();
  if (const auto asymmetric = field.find("asymmetric")) board.asymmetric = asymmetric->boolean();
  return board;
}

Points3d read_points(const Field& field) {
  field.only({"name", "type", "points_m"});
  Points3d board;
  for (const Field& point : field.at("points_m").items()) {
    const std::vector<double> p = point.numbers(3);
    board.points_m.emplace_back(p[0], p[1], p[2]);
  }
  return board;
}

TargetSpec read_spec(const Field& field);

BoardRig read_rig_of_boards(const Field& field) {
  field.only({"name", "type", "parts"});
  BoardRig rig;
  for (const Field& part : field.at("parts").items()) {
    part.only({"board", "pose"});
    rig.parts.push_back({read_spec(part.at("board")), read_pose(part.at("pose"))});
    if (std::holds_alternative<BoardRig>(rig.parts.back().board))
      part.at("board").fail("a rig within a rig is not known");
  }
  return rig;
}

TargetSpec read_spec(const Field& field) {
  const Field type = field.at("type");
  const std::string word = type.text();
  if (word == Chessboard::kType) return read_chessboard(field);
  if (word == Charuco::kType) return read_charuco(field);
  if (word == AprilGrid::kType) return read_aprilgrid(field);
  if (word == Circles::kType) return read_circles(field);
  if (word == Points3d::kType) return read_points(field);
  if (word == BoardRig::kType) return read_rig_of_boards(field);
  std::string known;
  for (const TargetType& one : target_types()) known += (known.empty() ? "" : ", ") + std::string(one.type);
  type.fail(fmt::format("no target is of type '{}'; known are: {}", word.substr(0, 40), known));
}

/// Kalibr's own files. Its rows and columns count inner corners and circles as ours do, and spacingMeters of
/// an asymmetric grid is, as ours, half the distance of neighbours in a row: there circle (r, c) is at (2 c +
/// r % 2, r). What differs is its frame, whose x runs along the rows for boards other than asymmetric grids
/// and AprilGrids; a calibration does not depend on it. Keys that are not known are passed over: these files
/// come from elsewhere, and what is read here is required, so that a misspelt key is missed by its name.
TargetSpec read_kalibr(const Field& field) {
  const Field type = field.at("target_type");
  const std::string word = type.text();
  const auto count = [&](const char* key) { return field.at(key).integer(1, 100000); };
  if (word == "aprilgrid") {
    const auto offset = field.find("codeOffset");
    return AprilGrid{count("tagCols"),
                     count("tagRows"),
                     field.at("tagSize").number(),
                     field.at("tagSpacing").number(),
                     "36h11",
                     offset ? offset->integer(0, kMaxInt) : 0};
  }
  if (word == "checkerboard") {
    const double rows_m = field.at("rowSpacingMeters").number(),
                 columns_m = field.at("colSpacingMeters").number();
    if (rows_m != columns_m) {
      field.at("colSpacingMeters")
          .fail(fmt::format("{} m, but rowSpacingMeters is {} m: only squares are known; for rectangles give "
                            "the corners as "
                            "type: points",
                            columns_m, rows_m),
                ErrorCode::kUnsupported);
    }
    return Chessboard{count("targetCols"), count("targetRows"), rows_m};
  }
  if (word == "circlegrid") {
    return Circles{count("targetCols"), count("targetRows"), field.at("spacingMeters").number(), 0.0,
                   field.at("asymmetricGrid").boolean()};
  }
  type.fail(fmt::format("Kalibr has no target_type '{}'; known are: aprilgrid, checkerboard, circlegrid",
                        word.substr(0, 40)));
}

/// The last line closes a bracket of a required key, or is a required key itself: so a file that was cut off
/// anywhere is not taken for another board.
void write_spec(std::string& out, const std::string& indent, const TargetSpec& spec) {
  const auto line = [&](std::string_view key, const std::string& value) {
    out += fmt::format("{}{}: {}\n", indent, key, value);
  };
  const auto counts = [](int columns, int rows) { return fmt::format("[{}, {}]", columns, rows); };
  const std::string type(target_type(spec));
  if (const auto* b = std::get_if<Chessboard>(&spec)) {
    line("type", type);
    line("square_m", number_text(b->square_m));
    line("corners", counts(b->columns, b->rows));
  } else if (const auto* c = std::get_if<Charuco>(&spec)) {
    line("type", type);
    line("square_m", number_text(c->square_m));
    line("marker_m", number_text(c->marker_m));
    line("dictionary", yaml_text(c->dictionary));
    line("first_id", std::to_string(c->first_id));
    line("layout", std::string(kLayouts[static_cast<std::size_t>(c->layout)]));
    line("squares", counts(c->columns, c->rows));
  } else if (const auto* a = std::get_if<AprilGrid>(&spec)) {
    line("type", type);
    line("tag_m", number_text(a->tag_m));
    line("spacing", number_text(a->spacing));
    line("family", yaml_text(a->family));
    line("first_id", std::to_string(a->first_id));
    if (a->border != 2) line("border", std::to_string(a->border));
    line("tags", counts(a->columns, a->rows));
  } else if (const auto* d = std::get_if<Circles>(&spec)) {
    line("type", type);
    line("spacing_m", number_text(d->spacing_m));
    if (d->diameter_m != 0) line("diameter_m", number_text(d->diameter_m));
    line("asymmetric", d->asymmetric ? "true" : "false");
    line("circles", counts(d->columns, d->rows));
  } else if (const auto* p = std::get_if<Points3d>(&spec)) {
    out += indent + "points_m:\n";
    for (const Vec3& point : p->points_m) out += fmt::format("{}  - {}\n", indent, yaml_numbers(point));
    line("type", type);
  } else if (const auto* r = std::get_if<BoardRig>(&spec)) {
    out += indent + "parts:\n";
    for (const BoardPart& part : r->parts) {
      out += indent + "  - board:\n";
      write_spec(out, indent + "      ", part.board);
      out += indent + "    pose: " + pose_text(part.T_target_board) + "\n";
    }
    line("type", type);
  }
}

}  // namespace

SE3 read_pose(const Field& field) {
  field.only({"rotation_rad", "translation_m", "quaternion_wxyz"});
  const std::vector<double> t = field.at("translation_m").numbers(3);
  SE3 T;
  if (const auto quaternion = field.find("quaternion_wxyz")) {
    const std::vector<double> q = quaternion->numbers(4);
    const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (!(std::abs(norm - 1) < 1e-3))
      quaternion->fail(fmt::format("a unit quaternion is needed, its length is {}", norm));
    // One of ours comes back to the last bit; one typed with a few digits is made a rotation.
    const double scale = std::abs(norm - 1) < 1e-12 ? 1.0 : 1 / norm;
    T.qt = {q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale, t[0], t[1], t[2]};
    return T;
  }
  const std::vector<double> w = field.at("rotation_rad").numbers(3);
  const double angle = Vec3(w[0], w[1], w[2]).norm();
  if (!(angle < 100))
    field.at("rotation_rad").fail(fmt::format("a rotation by {} rad: are these degrees?", angle));
  return {so3_exp({w[0], w[1], w[2]}), {t[0], t[1], t[2]}};
}

std::string pose_text(const SE3& T) {
  return fmt::format("{{quaternion_wxyz: {}, translation_m: {}}}", yaml_numbers(T.qt.data(), 4),
                     yaml_numbers(T.qt.data() + 4, 3));
}

Target read_target(const Field& field) {
  if (field.has("target_type")) return value_or_throw(make_target(read_kalibr(field)), field);
  if (!field.has("type")) field.fail("not a target: it has no 'type' (ours) and no 'target_type' (Kalibr's)");
  const auto name = field.find("name");
  return value_or_throw(make_target(read_spec(field), name ? name->text() : ""), field);
}

void write_target(std::string& out, const std::string& indent, const Target& target) {
  if (!target.name.empty()) out += fmt::format("{}name: {}\n", indent, yaml_text(target.name));
  write_spec(out, indent, target.spec);
}

}  // namespace io

Result<Target> parse_target(std::string_view yaml) {
  return io::read_yaml<Target>(yaml, "", io::read_target);
}

std::string format_target(const Target& target) {
  std::string out;
  io::write_target(out, "", target);
  return out;
}

}  // namespace plumbline
