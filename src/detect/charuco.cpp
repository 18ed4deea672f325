// SPDX-License-Identifier: Apache-2.0
#include "detect/charuco.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "detect/bends.hpp"
#include "detect/finders.hpp"
#include "detect/strays.hpp"
#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

/// Squares as units, origin at inner corner (0, 0): square (c, r) covers [c - 1, c] x [r - 1, r].
struct Layout {
  bool marker_in_first_square = false;  ///< legacy boards with an even number of rows
  bool has_marker(int c, int r) const { return ((c + r) % 2 == 0) == marker_in_first_square; }
};

/// Board corners of each marker id, counted from the board's first: row by row from the top left, clockwise.
std::vector<std::array<Vec2, 4>> marker_corners(const Charuco& board, const Layout& layout) {
  const double margin = (1 - board.marker_m / board.square_m) / 2;
  std::vector<std::array<Vec2, 4>> out;
  for (int r = 0; r < board.rows; ++r) {
    for (int c = 0; c < board.columns; ++c) {
      if (!layout.has_marker(c, r)) continue;
      const double x0 = c - 1 + margin, x1 = c - margin, y0 = r - 1 + margin, y1 = r - margin;
      out.push_back({Vec2(x0, y0), Vec2(x1, y0), Vec2(x1, y1), Vec2(x0, y1)});
    }
  }
  return out;
}

struct Placement {
  Layout layout;
  std::vector<PlacedQuad> quads;
  ConsistentQuads consistent;
};

Placement place(const Charuco& board, const Layout& layout, const std::vector<Marker>& markers) {
  Placement out{layout, {}, {}};
  const auto corners = marker_corners(board, layout);
  for (const Marker& m : markers) {
    const int i = m.id - board.first_id;
    if (i >= 0 && i < static_cast<int>(corners.size()))
      out.quads.push_back({m.id, corners[static_cast<std::size_t>(i)], m.px});
  }
  out.consistent = consistent_quads(out.quads);
  return out;
}

/// The local map at an inner corner, or nullopt when no marker touches it.
std::optional<Mat3> plane_at(const Placement& placed, const Vec2& corner) {
  const auto near = nearest_quads(placed.quads, placed.consistent.index, corner, 4);
  std::vector<Vec2> from, to;
  bool is_touched = false;
  for (int q : near) {
    const PlacedQuad& quad = placed.quads[static_cast<std::size_t>(q)];
    const double distance = (quad.board_centre() - corner).lpNorm<Eigen::Infinity>();
    is_touched |= distance < 0.75;
    if (distance > 2.25) continue;  // a wide lens bends the board over larger distances
    from.insert(from.end(), quad.board.begin(), quad.board.end());
    to.insert(to.end(), quad.px.begin(), quad.px.end());
  }
  if (!is_touched) return std::nullopt;
  for (Vec2& p : from) p -= corner;
  return fit_plane(from, to);
}

constexpr int kMinCorners = 4;
constexpr std::size_t kEnoughToJudge =
    11;  ///< markers of which most lie as on the board, or it is another one
constexpr std::size_t kMinToCompare = 10;  ///< corners of which one can be told to be a stray
constexpr double kMinReach = 1.5;          ///< [px] between an edge and the markers beside it

struct Candidates {
  std::vector<CornerStart> starts;
  std::vector<int> points;
  std::map<int, SaddleWindow> windows;  ///< by point
};

/// Where the markers say that corners are, and which pixels around them are clean.
Candidates candidates(const cv::Mat& grey, const Charuco& board, const Placement& placed) {
  const double margin = (1 - board.marker_m / board.square_m) / 2;
  Candidates out;
  for (int r = 0; r + 1 < board.rows; ++r) {
    for (int c = 0; c + 1 < board.columns; ++c) {
      const auto H = plane_at(placed, Vec2(c, r));
      const auto px = H ? map_point(*H, Vec2(0, 0)) : std::nullopt;
      if (!px) continue;
      const Mat2 J = map_jacobian(*H, Vec2(0, 0));
      const double height = narrow_height(J), reach = margin * height;
      if (reach < kMinReach) continue;
      // The four fields at the corner have alternating brightness: else it is covered, or not this board's.
      if (std::abs(saddle_contrast(grey, *px, J.col(0) * margin * 0.7, J.col(1) * margin * 0.7)) < 10)
        continue;
      SaddleWindow window{J};
      // The squares' own edges are clean along their whole length; the markers stand beside them.
      window.across = margin;
      window.max_move_px = std::max(1.5, 0.2 * height);
      window.max_misfit = 0.9;  // the markers around it say that it is a corner
      out.starts.push_back({*px, window});
      out.points.push_back(r * (board.columns - 1) + c);
      out.windows[out.points.back()] = window;
    }
  }
  return out;
}

/// Four corners on a line say nothing about a camera.
bool spans_plane(const std::vector<Corner>& corners, int columns) {
  const auto at = [&](const Corner& c) { return Vec2(c.point % columns, c.point / columns); };
  for (std::size_t i = 2; i < corners.size(); ++i) {
    const Vec2 a = at(corners[1]) - at(corners[0]), b = at(corners[i]) - at(corners[0]);
    if (std::abs(a.x() * b.y() - a.y() * b.x()) > 0.5) return true;
  }
  return false;
}

}  // namespace

int layout_vote(const Charuco& board, const std::vector<Marker>& markers) {
  if (!has_open_layout(board)) return 0;
  const auto n = [&](bool is_legacy) {
    return static_cast<int>(place(board, {is_legacy}, markers).consistent.index.size());
  };
  // Only counts decide. With an odd number of columns the two layouts differ by a shift of one column
  // wherever the first column (of a current board; the last one of a legacy board) is not in view; their
  // errors are the same there but for rounding.
  return n(false) - n(true);
}

std::optional<Target> with_layout(const Target& target, Charuco::Layout layout) {
  Target out = target;
  bool is_open = false;
  const auto set = [&](TargetSpec& spec) {
    auto* charuco = std::get_if<Charuco>(&spec);
    if (charuco == nullptr || !has_open_layout(*charuco)) return;
    charuco->layout = layout;
    is_open = true;
  };
  set(out.spec);
  if (auto* rig = std::get_if<BoardRig>(&out.spec)) {
    for (BoardPart& part : rig->parts) set(part.board);
  }
  return is_open ? std::optional<Target>(std::move(out)) : std::nullopt;
}

Detection charuco_from_markers(const cv::Mat& grey, const Charuco& board,
                               const std::vector<Marker>& markers) {
  Detection out;
  out.layout_vote = layout_vote(board, markers);
  const bool is_legacy =
      board.rows % 2 == 0 && (board.layout == Charuco::Layout::kLegacy || out.layout_vote < 0);
  const Placement placed = place(board, {is_legacy}, markers);
  const std::size_t n = placed.consistent.index.size();
  if (n == 0) {
    out.reason = fmt::format("none of the {} markers of {} found", n_markers(board), board.dictionary);
    return out;
  }
  std::set<int> ids;
  for (const PlacedQuad& q : placed.quads) ids.insert(q.id);
  if (ids.size() >= kEnoughToJudge && 2 * n < ids.size()) {
    out.reason =
        fmt::format("only {} of the {} markers found lie as on this board: it is another one", n, ids.size());
    return out;
  }
  std::vector<Vec2> all_px;
  for (int i : placed.consistent.index)
    for (const Vec2& p : placed.quads[static_cast<std::size_t>(i)].px) all_px.push_back(p);
  const double noise = noise_level(grey, bounding_box(all_px, grey));
  const auto [starts, points, windows] = candidates(grey, board, placed);
  const auto refined = refine_corners(grey, starts, noise);
  std::vector<Refined> corners;
  for (std::size_t i = 0; i < refined.size(); ++i) {
    const Vec2 at(points[i] % (board.columns - 1), points[i] / (board.columns - 1));
    if (refined[i]) corners.push_back({points[i], at, refined[i]->px, refined[i]->sigma_px});
  }
  double limit = 0;
  if (corners.size() >= kMinToCompare) corners = without_strays(std::move(corners), limit);
  refit_bent(grey, noise, windows, corners);
  for (const Refined& r : corners) out.corners.push_back({r.point, r.px, r.sigma});
  if (out.corners.size() < kMinCorners || !spans_plane(out.corners, board.columns - 1)) {
    out.reason = fmt::format(
        "{} of {} corners found (from {} of {} markers), at least {} that are not on one line are needed",
        out.corners.size(), (board.columns - 1) * (board.rows - 1), n, n_markers(board), kMinCorners);
    out.corners.clear();
    return out;
  }
  out.method = fmt::format("ArUco{}, saddle fit", board.rows % 2 != 0 ? ""
                                                  : is_legacy         ? ", layout legacy"
                                                                      : ", layout current");
  return out;
}

Detection detect_charuco(const cv::Mat& grey, const Charuco& board) {
  return charuco_from_markers(grey, board, find_aruco(grey, board.dictionary, n_markers(board)));
}

}  // namespace plumbline::detail
