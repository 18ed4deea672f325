// SPDX-License-Identifier: Apache-2.0
#include "plumbline/target/target.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <set>
#include <utility>

#include "plumbline/core/linalg.hpp"

namespace plumbline {
namespace {

constexpr int kMaxPoints = 100000;

Error bad(const std::string& message) { return {ErrorCode::kInvalidData, message, "target"}; }

Status check_counts(std::string_view what, int columns, int rows) {
  if (columns < 2 || rows < 2) {
    return bad(fmt::format("{} {}x{}: at least 2 columns and 2 rows are needed", what, columns, rows));
  }
  if (static_cast<long>(columns) * rows > kMaxPoints) {
    return bad(fmt::format("{} {}x{}: more than {} points", what, columns, rows, kMaxPoints));
  }
  return {};
}

Status check_length(std::string_view field, double value) {
  if (std::isfinite(value) && value > 0 && value < 1e3) return {};
  return bad(fmt::format("{} is {}: a length in metres above 0 and below 1000 is needed", field, value));
}

#define PLUMBLINE_TRY(status) \
  if (Status failed = (status); !failed) return failed.error()

Result<std::vector<Vec3>> points_of(const Chessboard& b) {
  PLUMBLINE_TRY(check_counts("inner corners", b.columns, b.rows));
  PLUMBLINE_TRY(check_length("square", b.square_m));
  std::vector<Vec3> points;
  for (int r = 0; r < b.rows; ++r)
    for (int c = 0; c < b.columns; ++c) points.emplace_back(c * b.square_m, r * b.square_m, 0);
  return points;
}

Result<std::vector<Vec3>> points_of(const Charuco& b) {
  PLUMBLINE_TRY(check_counts("squares", b.columns, b.rows));
  if (b.columns < 3 || b.rows < 3) return bad("a ChArUco board needs at least 3x3 squares");
  PLUMBLINE_TRY(check_length("square", b.square_m));
  PLUMBLINE_TRY(check_length("marker", b.marker_m));
  if (!(b.marker_m < b.square_m)) {
    return bad(
        fmt::format("the marker ({} m) must be smaller than its square ({} m)", b.marker_m, b.square_m));
  }
  const auto size = dictionary_size(b.dictionary);
  if (!size)
    return bad(fmt::format("no ArUco dictionary is called '{}' (4X4_50, 5X5_1000, ...)", b.dictionary));
  const int n_markers = b.columns * b.rows / 2;
  if (b.first_id < 0 || b.first_id + n_markers > *size) {
    return bad(fmt::format("markers {}..{} are needed, dictionary {} has {}", b.first_id,
                           b.first_id + n_markers - 1, b.dictionary, *size));
  }
  return points_of(Chessboard{b.columns - 1, b.rows - 1, b.square_m});
}

Result<std::vector<Vec3>> points_of(const AprilGrid& b) {
  if (b.columns < 1 || b.rows < 1 || static_cast<long>(b.columns) * b.rows * 4 > kMaxPoints) {
    return bad(
        fmt::format("tags {}x{}: at least one, and at most {} in all", b.columns, b.rows, kMaxPoints / 4));
  }
  PLUMBLINE_TRY(check_length("tag-size", b.tag_m));
  if (!(b.spacing > 0 && b.spacing < 10)) {
    return bad(fmt::format(
        "tag-spacing is {}: a ratio of the tag's size is needed (0.3: the gap is 0.3 tags wide), not metres",
        b.spacing));
  }
  if (b.family != "36h11" && b.family != "25h9")
    return bad(fmt::format("tag family '{}' is not supported; there are: 36h11, 25h9", b.family));
  const int n_tags = dictionary_size("APRILTAG_" + b.family).value_or(0);
  if (b.first_id < 0 || b.first_id + b.columns * b.rows > n_tags) {
    return bad(fmt::format("tags {}..{} are needed, {} has {}", b.first_id,
                           b.first_id + b.columns * b.rows - 1, b.family, n_tags));
  }
  if (b.border != 1 && b.border != 2)
    return bad(fmt::format("a border of {} modules is not known; AprilTag's is 1, Kalibr's 2", b.border));
  const double pitch = b.tag_m * (1 + b.spacing);
  std::vector<Vec3> points;
  for (int r = 0; r < b.rows; ++r) {
    for (int c = 0; c < b.columns; ++c) {
      for (const auto& [dx, dy] : {std::pair{0, 0}, {1, 0}, {1, 1}, {0, 1}}) {
        points.emplace_back(c * pitch + dx * b.tag_m, r * pitch + dy * b.tag_m, 0);
      }
    }
  }
  return points;
}

Result<std::vector<Vec3>> points_of(const Circles& b) {
  PLUMBLINE_TRY(check_counts("circles", b.columns, b.rows));
  PLUMBLINE_TRY(check_length("spacing", b.spacing_m));
  // Neighbours touch at this diameter; a drawn circle must stay below it.
  const double touching_m = b.asymmetric ? std::sqrt(2.0) * b.spacing_m : b.spacing_m;
  if (!(b.diameter_m >= 0 && b.diameter_m < touching_m)) {
    return bad(fmt::format("circle diameter {} m: circles {} m apart would touch", b.diameter_m, touching_m));
  }
  std::vector<Vec3> points;
  for (int r = 0; r < b.rows; ++r) {
    for (int c = 0; c < b.columns; ++c) {
      points.emplace_back((b.asymmetric ? 2 * c + r % 2 : c) * b.spacing_m, r * b.spacing_m, 0);
    }
  }
  return points;
}

Result<std::vector<Vec3>> points_of(const Points3d& b) {
  if (b.points_m.size() < 4) return bad(fmt::format("{} points: at least 4 are needed", b.points_m.size()));
  if (b.points_m.size() > kMaxPoints) return bad(fmt::format("more than {} points", kMaxPoints));
  for (std::size_t i = 0; i < b.points_m.size(); ++i) {
    if (!b.points_m[i].allFinite()) return bad(fmt::format("point {} is not finite", i));
  }
  return b.points_m;
}

Result<std::vector<Vec3>> points_of(const BoardRig& rig) {
  if (rig.parts.empty()) return bad("a rig of boards needs at least one part");
  std::set<std::pair<std::string, int>> ids;  // (dictionary, marker id)
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < rig.parts.size(); ++i) {
    const auto add_ids = [&](const std::string& dictionary, int first, int n) -> Status {
      for (int id = first; id < first + n; ++id) {
        if (!ids.insert({dictionary, id}).second) {
          return bad(fmt::format(
              "part {}: id {} of {} is on another part too; give each board a first_id of its own", i, id,
              dictionary));
        }
      }
      return {};
    };
    Status unique =
        bad(fmt::format("part {}: only charuco and aprilgrid boards can be told apart in a rig", i));
    if (const auto* c = std::get_if<Charuco>(&rig.parts[i].board))
      unique = add_ids(c->dictionary, c->first_id, c->columns * c->rows / 2);
    if (const auto* a = std::get_if<AprilGrid>(&rig.parts[i].board))
      unique = add_ids(a->family, a->first_id, a->columns * a->rows);
    PLUMBLINE_TRY(std::move(unique));
    auto board = make_target(rig.parts[i].board);
    if (!board) return board.error();
    for (const Vec3& p : board->points) points.push_back(rig.parts[i].T_target_board * p);
  }
  return points;
}

std::string mm(double length_m) { return fmt::format("{:g}mm", 1e3 * length_m); }

std::string default_name(const TargetSpec& spec) {
  struct {
    std::string operator()(const Chessboard& b) {
      return fmt::format("chessboard_{}x{}_{}", b.columns, b.rows, mm(b.square_m));
    }
    std::string operator()(const Charuco& b) {
      return fmt::format("charuco_{}x{}_{}_{}", b.columns, b.rows, mm(b.square_m), b.dictionary);
    }
    std::string operator()(const AprilGrid& b) {
      return fmt::format("aprilgrid_{}x{}_{}", b.columns, b.rows, mm(b.tag_m));
    }
    std::string operator()(const Circles& b) {
      return fmt::format("{}_{}x{}_{}", b.asymmetric ? "acircles" : "circles", b.columns, b.rows,
                         mm(b.spacing_m));
    }
    std::string operator()(const Points3d& b) { return fmt::format("points_{}", b.points_m.size()); }
    std::string operator()(const BoardRig& b) { return fmt::format("rig_of_{}", b.parts.size()); }
  } name;
  return std::visit(name, spec);
}

std::optional<Lattice> lattice_of(const TargetSpec& spec) {
  if (const auto* b = std::get_if<Chessboard>(&spec)) return Lattice{b->columns, b->rows, b->square_m};
  if (const auto* b = std::get_if<Charuco>(&spec)) return Lattice{b->columns - 1, b->rows - 1, b->square_m};
  if (const auto* b = std::get_if<Circles>(&spec); b && !b->asymmetric)
    return Lattice{b->columns, b->rows, b->spacing_m};
  return std::nullopt;
}

bool planar(const std::vector<Vec3>& points) {
  Vec3 mean = Vec3::Zero();
  for (const Vec3& p : points) mean += p / static_cast<double>(points.size());
  Mat3 scatter = Mat3::Zero();
  for (const Vec3& p : points) scatter += (p - mean) * (p - mean).transpose();
  const Vec3 s = svd3(scatter).s;
  return s[2] <= 1e-18 * s[0];  // squared extents
}

}  // namespace

Result<Target> make_target(const TargetSpec& spec, std::string name) {
  auto points = std::visit([](const auto& board) { return points_of(board); }, spec);
  if (!points) return points.error();
  if (points->size() > kMaxPoints) return bad(fmt::format("more than {} points", kMaxPoints));
  Target target;
  target.name = name.empty() ? default_name(spec) : std::move(name);
  target.spec = spec;
  target.points = *std::move(points);
  target.lattice = lattice_of(spec);
  target.is_planar = planar(target.points);
  target.outline = outline_of(target.points);
  return target;
}

namespace {

// Markers of one board: codes first .. last of a family. OpenCV's 4X4_50 holds the first codes of 4X4_1000.
struct MarkerIds {
  std::string family;
  int first = 0, last = 0;
};

std::vector<MarkerIds> marker_ids(const TargetSpec& spec) {
  const auto family = [](const std::string& dictionary) {
    return dictionary.size() > 4 && dictionary[1] == 'X' ? dictionary.substr(0, 3) : dictionary;
  };
  if (const auto* c = std::get_if<Charuco>(&spec))
    return {{family(c->dictionary), c->first_id, c->first_id + c->columns * c->rows / 2 - 1}};
  if (const auto* a = std::get_if<AprilGrid>(&spec))
    return {{"APRILTAG_" + a->family, a->first_id, a->first_id + a->columns * a->rows - 1}};
  std::vector<MarkerIds> all;
  if (const auto* rig = std::get_if<BoardRig>(&spec)) {
    for (const BoardPart& part : rig->parts) {
      for (MarkerIds& ids : marker_ids(part.board)) all.push_back(std::move(ids));
    }
  }
  return all;
}

// Counts of a board without markers, the larger first: it may be seen from any side.
std::optional<std::pair<int, int>> counts(const TargetSpec& spec) {
  const auto sorted = [](int a, int b) { return std::pair(std::max(a, b), std::min(a, b)); };
  if (const auto* b = std::get_if<Chessboard>(&spec)) return sorted(b->columns, b->rows);
  if (const auto* b = std::get_if<Circles>(&spec)) return sorted(b->columns, b->rows);
  return std::nullopt;
}

Status check_pair(const Target& a, const Target& b) {
  const auto fail = [&](std::string message) {
    return Error{ErrorCode::kInvalidData, std::move(message), "targets " + a.name + " and " + b.name};
  };
  if (std::holds_alternative<Points3d>(a.spec) || std::holds_alternative<Points3d>(b.spec))
    return fail("free points cannot be told from other boards in an image");
  if (a.spec.index() == b.spec.index() && counts(a.spec) && counts(a.spec) == counts(b.spec))
    return fail(
        fmt::format("both are {}s of {}x{}, and nothing tells them apart in an image; take boards of "
                    "different counts, or ChArUco boards or AprilGrids with ids of their own",
                    target_type(a.spec), counts(a.spec)->first, counts(a.spec)->second));
  for (const MarkerIds& of_a : marker_ids(a.spec)) {
    for (const MarkerIds& of_b : marker_ids(b.spec)) {
      const int first = std::max(of_a.first, of_b.first), last = std::min(of_a.last, of_b.last);
      if (of_a.family != of_b.family || first > last) continue;
      return fail(
          fmt::format("both have the markers {} to {} (ids {} to {} and {} to {} of {}); print one of them "
                      "with other ids "
                      "and give it a first_id of its own, {} for example",
                      first, last, of_a.first, of_a.last, of_b.first, of_b.last, of_a.family, of_a.last + 1));
    }
  }
  return {};
}

}  // namespace

Status check_distinct(const std::vector<Target>& targets) {
  for (std::size_t i = 0; i < targets.size(); ++i) {
    for (std::size_t k = i + 1; k < targets.size(); ++k) PLUMBLINE_TRY(check_pair(targets[i], targets[k]));
  }
  return {};
}

std::string_view target_type(const TargetSpec& spec) {
  return std::visit([](const auto& board) { return board.kType; }, spec);
}

std::vector<TargetType> target_types() {
  std::vector<TargetType> types;
  [&]<std::size_t... I>(std::index_sequence<I...>) {
    (types.push_back({std::variant_alternative_t<I, TargetSpec>::kType,
                      std::variant_alternative_t<I, TargetSpec>::kSummary}),
     ...);
  }
  (std::make_index_sequence<std::variant_size_v<TargetSpec>>{});
  return types;
}

std::optional<Vec2> pattern_size_m(const TargetSpec& spec) {
  if (const auto* b = std::get_if<Chessboard>(&spec)) return Vec2(b->columns + 1, b->rows + 1) * b->square_m;
  if (const auto* b = std::get_if<Charuco>(&spec)) return Vec2(b->columns, b->rows) * b->square_m;
  if (const auto* b = std::get_if<AprilGrid>(&spec)) {
    // tags, the gaps between them, and the corner squares that stick out all around
    return Vec2(b->columns + (b->columns + 1) * b->spacing, b->rows + (b->rows + 1) * b->spacing) * b->tag_m;
  }
  if (const auto* b = std::get_if<Circles>(&spec)) {
    const double columns = b->asymmetric ? 2 * (b->columns - 1) + 1 : b->columns - 1;
    const double diameter_m = b->diameter_m > 0 ? b->diameter_m : (b->asymmetric ? 0.8 : 0.5) * b->spacing_m;
    return Vec2(columns * b->spacing_m + diameter_m, (b->rows - 1) * b->spacing_m + diameter_m);
  }
  return std::nullopt;
}

std::optional<int> dictionary_size(std::string_view dictionary) {
  if (dictionary == "ARUCO_ORIGINAL") return 1024;
  if (dictionary == "APRILTAG_16h5") return 30;
  if (dictionary == "APRILTAG_25h9") return 35;
  if (dictionary == "APRILTAG_36h10") return 2320;
  if (dictionary == "APRILTAG_36h11") return 587;
  if (dictionary.size() < 6) return std::nullopt;
  const std::string_view bits = dictionary.substr(0, 4), count = dictionary.substr(4);
  if (bits != "4X4_" && bits != "5X5_" && bits != "6X6_" && bits != "7X7_") return std::nullopt;
  for (const auto& [text, n] : {std::pair{"50", 50}, {"100", 100}, {"250", 250}, {"1000", 1000}}) {
    if (count == text) return n;
  }
  return std::nullopt;
}

bool is_half_turn_symmetric(const TargetSpec& spec) {
  // A half turn maps the square right of and below the first corner to the one left of and above the last:
  // the colours agree when columns + rows is even.
  if (const auto* b = std::get_if<Chessboard>(&spec)) return (b->columns + b->rows) % 2 == 0;
  if (const auto* b = std::get_if<Circles>(&spec)) return !b->asymmetric || b->rows % 2 == 0;
  return false;
}

}  // namespace plumbline
