// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "detect/charuco.hpp"
#include "detect/finders.hpp"
#include "detect/planar.hpp"
#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

constexpr int kMinTags = 4;

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

/// Starts for the four corners of a tag. `H` maps from the tag's centre.
void add_candidates(const cv::Mat& grey, const AprilGrid& board, const PlacedQuad& tag, const Mat3& H,
                    std::vector<Candidate>& out) {
  for (std::size_t k = 0; k < 4; ++k) {
    const Vec2 local = tag.board[k] - tag.board_centre();
    const auto predicted = map_point(H, local);
    if (!predicted) continue;
    const Mat2 J = map_jacobian(H, local);
    const double gap = board.spacing * std::min(J.col(0).norm(), J.col(1).norm());
    // The detector's own corner where it agrees with the neighbourhood; it is nearer than a plane is to a
    // wide lens.
    const Vec2 start =
        (tag.px[k] - *predicted).norm() < 0.5 * gap ? Vec2((tag.px[k] + *predicted) / 2) : *predicted;
    // Inside the tag's border (0.2 wide) and inside the small square (`spacing` wide) it is black, beside
    // them white.
    const double reach = 0.5 * std::min(0.2, board.spacing);
    if (saddle_contrast(grey, start, J.col(0) * reach, J.col(1) * reach * (k % 2 == 0 ? 1 : -1)) > -8)
      continue;
    // Clean as far as the tag's border and the small square go, whichever ends first.
    const double clean = std::min(0.2, board.spacing) * std::min(J.col(0).norm(), J.col(1).norm());
    out.push_back({(tag.id - board.first_id) * 4 + static_cast<int>(k),
                   tag.board[k],
                   {start, half_window(0.9 * clean), std::max(1.5, 0.6 * gap)}});
  }
}

/// Without the corners that do not lie where the eight to sixteen refined ones nearest to them say.
std::vector<Corner> without_strays(const std::vector<Candidate>& candidates,
                                   const std::vector<std::optional<RefinedCorner>>& refined, double tag_px) {
  std::vector<std::size_t> good;
  for (std::size_t i = 0; i < refined.size(); ++i)
    if (refined[i]) good.push_back(i);
  std::vector<Corner> out;
  for (std::size_t i : good) {
    std::vector<std::size_t> near;
    for (std::size_t j : good)
      if (j != i) near.push_back(j);
    const auto distance = [&](std::size_t j) {
      return (candidates[j].board - candidates[i].board).squaredNorm();
    };
    std::stable_sort(near.begin(), near.end(), [&](auto a, auto b) { return distance(a) < distance(b); });
    near.resize(std::min<std::size_t>(near.size(), 12));
    std::vector<Vec2> from, to;
    for (std::size_t j : near) {
      from.push_back(candidates[j].board - candidates[i].board);
      to.push_back(refined[j]->px);
    }
    const auto H = fit_plane(from, to, 0.04 * tag_px);
    const auto predicted = H ? map_point(*H, Vec2(0, 0)) : std::nullopt;
    if (!predicted || (*predicted - refined[i]->px).norm() > std::max(1.0, 0.06 * tag_px)) continue;
    out.push_back({candidates[i].point, refined[i]->px, refined[i]->sigma_px});
  }
  return out;
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
  double tag_px = 0;
  for (int i : consistent.index) {
    const PlacedQuad& q = quads[static_cast<std::size_t>(i)];
    px.insert(px.end(), q.px.begin(), q.px.end());
    tag_px += side_px(q.px) / n;
  }
  std::vector<Candidate> candidates;
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
  std::vector<CornerStart> starts;
  for (const Candidate& c : candidates) starts.push_back(c.start);
  const auto refined = refine_corners(grey, starts, noise_level(grey, bounding_box(px, grey)));
  out.corners = without_strays(candidates, refined, tag_px);
  std::sort(out.corners.begin(), out.corners.end(),
            [](const Corner& a, const Corner& b) { return a.point < b.point; });
  if (out.corners.size() < 4) {
    out.reason = fmt::format("{} of {} tags found, but only {} of their corners are clear", n, all,
                             out.corners.size());
    out.corners.clear();
    return out;
  }
  out.method = "AprilTag and ArUco, cornerSubPix";
  return out;
}

Detection detect_aprilgrid(const cv::Mat& grey, const AprilGrid& board) {
  return aprilgrid_from_tags(grey, board, find_april_tags(grey));
}

}  // namespace plumbline::detail
