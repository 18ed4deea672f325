// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/target/bow.hpp"

/// What was printed: the points of a target in its own frame, and how to recognise them.
///
/// The board frame: origin at point 0, metres. Chessboards, ChArUco boards and circle grids are written as
/// they are seen: x to the right, y DOWN, z into the board; points row by row from the top left, as OpenCV
/// numbers them. An AprilGrid follows Kalibr: x to the right, y UP, tag 0 at the bottom left, z out of the
/// board.
namespace plumbline {

/// columns x rows INNER corners (a board of 10x7 squares has 9x6). Point r * columns + c is at (c, r) *
/// square_m.
struct Chessboard {
  static constexpr std::string_view kType = "chessboard";
  static constexpr std::string_view kSummary = "black and white squares; counted in inner corners";
  int columns = 9, rows = 6;
  double square_m = 0.025;
  bool operator==(const Chessboard&) const = default;
};

/// columns x rows SQUARES with a marker in every white one. Inner corner r * (columns - 1) + c is at
/// (c, r) * square_m. Two layouts exist: current (OpenCV >= 4.6: the top-left square is black) and legacy
/// (OpenCV < 4.6, for even row counts: a marker stands in the top-left square). For odd row counts they are
/// the same.
struct Charuco {
  static constexpr std::string_view kType = "charuco";
  static constexpr std::string_view kSummary = "chessboard with ArUco markers in the white squares";
  enum class Layout { kAuto, kCurrent, kLegacy };
  int columns = 8, rows = 11;
  double square_m = 0.030, marker_m = 0.022;
  std::string dictionary = "4X4_50";  ///< OpenCV's name without DICT_
  int first_id = 0;                   ///< of the first marker; boards of one rig have ids of their own
  Layout layout = Layout::kAuto;      ///< kAuto: the detector tries both; printing draws the current one
  bool operator==(const Charuco&) const = default;
};

/// Kalibr's grid of columns x rows AprilTags ("36h11", "25h9") with small black squares where tags meet.
/// Kalibr prints a border two modules wide; border says how wide it is drawn, 1 or 2, and the detector reads
/// both. spacing is the gap as a RATIO of the tag's size. Tag t (row t / columns from the BOTTOM) has points
/// 4t + 0..3: bottom left, bottom right, top right, top left; its bottom-left corner is at (t % columns, t /
/// columns) * tag_m * (1 + spacing).
struct AprilGrid {
  static constexpr std::string_view kType = "aprilgrid";
  static constexpr std::string_view kSummary = "Kalibr's grid of AprilTags (36h11 or 25h9)";
  int columns = 6, rows = 6;
  double tag_m = 0.088, spacing = 0.3;
  std::string family = "36h11";
  int first_id = 0;
  int border = 2;  ///< modules of black around a tag's bits; tag_m is the side with it
  bool operator==(const AprilGrid&) const = default;
};

/// columns x rows dark circles; circle r * columns + c is at (c, r) * spacing_m. Asymmetric (OpenCV's
/// ASYMMETRIC_GRID, columns = circles in one row): at (2 c + r % 2, r) * spacing_m, so spacing_m is HALF the
/// distance of neighbours within a row.
struct Circles {
  static constexpr std::string_view kType = "circles";
  static constexpr std::string_view kSummary = "grid of dark circles, symmetric or asymmetric";
  int columns = 9, rows = 7;
  double spacing_m = 0.02;
  double diameter_m = 0.0;  ///< for printing; 0: half of the spacing (symmetric), 0.8 spacing (asymmetric)
  bool asymmetric = false;
  bool operator==(const Circles&) const = default;
};

/// Any points known in 3-D; found by other software and read from a corners file.
struct Points3d {
  static constexpr std::string_view kType = "points";
  static constexpr std::string_view kSummary = "free 3-D points, observed by other software";
  std::vector<Vec3> points_m;
  bool operator==(const Points3d&) const = default;
};

struct BoardRig;
using TargetSpec = std::variant<Chessboard, Charuco, AprilGrid, Circles, Points3d, BoardRig>;

/// One board of a BoardRig: p_target = T_target_board * p_board.
struct BoardPart;

/// Several boards with ids of their own (ChArUco, AprilGrid) in fixed known poses. Its points are the boards'
/// points one board after the other.
struct BoardRig {
  static constexpr std::string_view kType = "rig";
  static constexpr std::string_view kSummary = "several boards with distinct ids in fixed known poses";
  std::vector<BoardPart> parts;
  bool operator==(const BoardRig&) const;
};

struct BoardPart {
  TargetSpec board;
  SE3 T_target_board;
  bool operator==(const BoardPart&) const = default;
};

inline bool BoardRig::operator==(const BoardRig& other) const { return parts == other.parts; }

/// Points on a uniform grid: point r * columns + c at (c, r) * spacing_m, z = 0. What mrcal's board API
/// takes.
struct Lattice {
  int columns = 0, rows = 0;
  double spacing_m = 0;
};

/// A target and its points. Made by make_target, so that spec and points agree.
struct Target {
  std::string name;  ///< "chessboard_9x6_25mm"
  TargetSpec spec = Chessboard{};
  std::vector<Vec3> points;        ///< [m] target frame; the index IS the point id
  std::optional<Lattice> lattice;  ///< absent when the points are not a uniform grid
  bool is_planar = true;           ///< all points in one plane to 1e-9 of their extent
  std::optional<Outline> outline;  ///< outline_of(points)
};

/// Points of a spec. kInvalidData names the field: fewer than 2 rows or columns, sizes not positive or not
/// finite, marker not smaller than its square, unknown dictionary or family, more markers than the dictionary
/// has, parts of a rig that share ids or that are neither ChArUco nor AprilGrid, fewer than 4 points, more
/// than 100,000 points.
Result<Target> make_target(const TargetSpec& spec, std::string name = "");

/// Whether several boards can be told apart in one image, by their names in the messages. kInvalidData:
/// ChArUco boards or AprilGrids that share marker ids (says which, and the first_id that would do),
/// chessboards or circle grids of the same counts, free points together with anything.
Status check_distinct(const std::vector<Target>& targets);

/// "chessboard", "charuco", ... of a spec, and all of them with their summaries in the order of the list.
std::string_view target_type(const TargetSpec& spec);
struct TargetType {
  std::string_view type, summary;
};
std::vector<TargetType> target_types();

/// Sides of the drawn pattern without margin [m] (outer squares, circles' edges); nullopt for points and
/// rigs.
std::optional<Vec2> pattern_size_m(const TargetSpec& spec);

/// Number of markers in an ArUco dictionary of OpenCV ("4X4_50" -> 50), nullopt when there is none of that
/// name.
std::optional<int> dictionary_size(std::string_view dictionary);

/// Whether the spec's appearance is the same after a half turn (then frames of several cameras may disagree
/// about which corner is the first): chessboards with both counts even or both odd, symmetric circles.
bool is_half_turn_symmetric(const TargetSpec& spec);

}  // namespace plumbline
