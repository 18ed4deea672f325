// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "detect/bends.hpp"
#include "detect/charuco.hpp"
#include "detect/finders.hpp"
#include "detect/planar.hpp"
#include "detect/strays.hpp"
#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

constexpr int kMinTags = 4;
constexpr double kMinClean = 1.6;  ///< [px] beside an edge, see add_candidate

/// Board in units of the tag's size, Kalibr's axes (y up), counted from point 0.
std::vector<PlacedQuad> place(const AprilGrid& board, const std::vector<Marker>& tags) {
  std::vector<PlacedQuad> out;
  for (const Marker& tag : tags) {
    const int t = tag.id - board.first_id;
    if (t < 0 || t >= board.columns * board.rows) continue;
    const Vec2 o = Vec2(t % board.columns, t / board.columns) * (1 + board.spacing);
    out.push_back({tag.id, {o, o + Vec2(1, 0), o + Vec2(1, 1), o + Vec2(0, 1)}, tag.px});
  }
  return out;
}

/// Where a tag's corners should be, from the tags around it and itself, without those few corners that a
/// small black square has pulled away. nullopt: too few neighbours; then the tag's own corners are all there
/// is.
std::optional<Mat3> plane_at(const std::vector<PlacedQuad>& quads, const std::vector<int>& tags,
                             const PlacedQuad& tag, double pitch) {
  std::vector<Vec2> from, to;
  for (int i : nearest_quads(quads, tags, tag.board_centre(), 9)) {
    const PlacedQuad& q = quads[static_cast<std::size_t>(i)];
    if ((q.board_centre() - tag.board_centre()).lpNorm<Eigen::Infinity>() > 1.5 * pitch) continue;
    for (std::size_t k = 0; k < 4; ++k) {
      from.push_back(q.board[k] - tag.board_centre());
      to.push_back(q.px[k]);
    }
  }
  if (from.size() < 12) return std::nullopt;
  return fit_plane(from, to, 0.08 * side_px(tag.px));
}

struct Candidate {
  int point;
  Vec2 board;
  CornerStart start;
};

/// A start for corner k of a tag at `start`, unless the picture there is no corner of a tag. J: d px / d
/// board.
void add_candidate(const cv::Mat& grey, const AprilGrid& board, const PlacedQuad& tag, std::size_t k,
                   const Mat2& J, const Vec2& start, std::vector<Candidate>& out) {
  const double height = narrow_height(J), gap = board.spacing * height;
  // Inside the tag's border (0.2 wide) and inside the small square (`spacing` wide) it is black, beside them
  // white.
  const double clean = std::min(0.2, board.spacing);
  // Narrower than that and the edge is not told from the border's other edge.
  if (clean * height < kMinClean) return;
  const Vec2 u = J.col(0) * (0.5 * clean), v = J.col(1) * (k % 2 == 0 ? 0.5 * clean : -0.5 * clean);
  if (saddle_contrast(grey, start, u, v) > -8) return;
  SaddleWindow window{J};
  window.across = clean;
  window.max_move_px = std::max(1.5, 0.5 * gap);
  // Into the tag its own edge runs on; the other way the small square ends with the gap.
  const bool tag_is_right = k == 0 || k == 3, tag_is_up = k == 0 || k == 1;
  window.low = Vec2(tag_is_right ? -board.spacing : -1, tag_is_up ? -board.spacing : -1);
  window.high = Vec2(tag_is_right ? 1 : board.spacing, tag_is_up ? 1 : board.spacing);
  out.push_back({(tag.id - board.first_id) * 4 + static_cast<int>(k), tag.board[k], {start, window}});
}

/// Starts for the four corners of a tag. `H` maps from the tag's centre.
void add_candidates(const cv::Mat& grey, const AprilGrid& board, const PlacedQuad& tag, const Mat3& H,
                    std::vector<Candidate>& out) {
  const Vec2 centre = tag.board_centre();
  for (std::size_t k = 0; k < 4; ++k) {
    const auto predicted = map_point(H, tag.board[k] - centre);
    if (!predicted) continue;
    const Mat2 J = map_jacobian(H, tag.board[k] - centre);
    const double gap = board.spacing * narrow_height(J);
    // The detector's own corner where it agrees with the neighbourhood; it is nearer than a plane is to a
    // wide lens.
    const bool agree = (tag.px[k] - *predicted).norm() < 0.5 * gap;
    add_candidate(grey, board, tag, k, J, agree ? Vec2((tag.px[k] + *predicted) / 2) : *predicted, out);
  }
}

std::vector<Refined> refine(const cv::Mat& grey, const std::vector<Candidate>& candidates, double noise) {
  std::vector<CornerStart> starts;
  for (const Candidate& c : candidates) starts.push_back(c.start);
  const auto refined = refine_corners(grey, starts, noise);
  std::vector<Refined> out;
  for (std::size_t i = 0; i < refined.size(); ++i) {
    if (refined[i])
      out.push_back({candidates[i].point, candidates[i].board, refined[i]->px, refined[i]->sigma_px});
  }
  return out;
}

/// Corners that had a bad start, or none, once more from where their good neighbours say.
void add_missing(const cv::Mat& grey, const AprilGrid& board, const std::vector<PlacedQuad>& quads,
                 const std::vector<int>& tags, double noise, std::vector<Refined>& corners) {
  std::vector<Candidate> again;
  for (int i : tags) {
    const PlacedQuad& tag = quads[static_cast<std::size_t>(i)];
    for (std::size_t k = 0; k < 4; ++k) {
      const int point = (tag.id - board.first_id) * 4 + static_cast<int>(k);
      if (std::any_of(corners.begin(), corners.end(), [&](const Refined& r) { return r.point == point; }))
        continue;
      if (const auto at = predict(corners, tag.board[k], point))
        add_candidate(grey, board, tag, k, at->J, at->px, again);
    }
  }
  const auto found = refine(grey, again, noise);
  corners.insert(corners.end(), found.begin(), found.end());
}

}  // namespace

Detection aprilgrid_from_tags(const cv::Mat& grey, const AprilGrid& board, const std::vector<Marker>& tags) {
  Detection out;
  const std::vector<PlacedQuad> quads = place(board, tags);
  const ConsistentQuads consistent = consistent_quads(quads);
  const int n = static_cast<int>(consistent.index.size()), all = board.columns * board.rows;
  const int needed = std::min(kMinTags, all);
  if (n < needed) {
    out.reason = fmt::format("{} of {} tags found, at least {} are needed", n, all, needed);
    return out;
  }
  std::vector<Vec2> px;
  for (int i : consistent.index) {
    const PlacedQuad& q = quads[static_cast<std::size_t>(i)];
    px.insert(px.end(), q.px.begin(), q.px.end());
  }
  std::vector<Candidate> candidates;
  std::map<int, SaddleWindow> windows;
  for (int i : consistent.index) {
    const PlacedQuad& tag = quads[static_cast<std::size_t>(i)];
    auto H = plane_at(quads, consistent.index, tag, 1 + board.spacing);
    if (!H) {
      std::array<Vec2, 4> local = tag.board;
      for (Vec2& p : local) p -= tag.board_centre();
      H = fit_plane(local, tag.px);
    }
    if (H) add_candidates(grey, board, tag, *H, candidates);
  }
  for (const Candidate& c : candidates) windows[c.point] = c.start.window;
  const double noise = noise_level(grey, bounding_box(px, grey));
  double limit = 0;
  std::vector<Refined> corners = without_strays(refine(grey, candidates, noise), limit);
  add_missing(grey, board, quads, consistent.index, noise, corners);
  corners = without_strays(std::move(corners), limit);
  refit_bent(grey, noise, windows, corners);
  for (const Refined& r : corners) out.corners.push_back({r.point, r.px, r.sigma});
  std::sort(out.corners.begin(), out.corners.end(),
            [](const Corner& a, const Corner& b) { return a.point < b.point; });
  if (out.corners.size() < 4) {
    out.reason = fmt::format("{} of {} tags found, but only {} of their corners are clear", n, all,
                             out.corners.size());
    out.corners.clear();
    return out;
  }
  out.method = "AprilTag and ArUco, saddle fit";
  return out;
}

Detection detect_aprilgrid(const cv::Mat& grey, const AprilGrid& board) {
  return aprilgrid_from_tags(grey, board, find_april_tags(grey));
}

}  // namespace plumbline::detail
