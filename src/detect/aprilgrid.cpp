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

/// A start for corner k of a tag at `start`, unless the picture there is no corner of a tag. H maps from
/// `origin`.
void add_candidate(const cv::Mat& grey, const AprilGrid& board, const PlacedQuad& tag, std::size_t k,
                   const Mat3& H, const Vec2& origin, const Vec2& start, std::vector<Candidate>& out) {
  const Mat2 J = map_jacobian(H, tag.board[k] - origin);
  const double scale = std::min(J.col(0).norm(), J.col(1).norm()), gap = board.spacing * scale;
  // Inside the tag's border (0.2 wide) and inside the small square (`spacing` wide) it is black, beside them
  // white.
  const double clean = std::min(0.2, board.spacing);
  const Vec2 u = J.col(0) * (0.5 * clean), v = J.col(1) * (k % 2 == 0 ? 0.5 * clean : -0.5 * clean);
  if (saddle_contrast(grey, start, u, v) > -8) return;
  out.push_back({(tag.id - board.first_id) * 4 + static_cast<int>(k),
                 tag.board[k],
                 {start, half_window(0.9 * clean * scale), std::max(1.5, 0.6 * gap)}});
}

/// Starts for the four corners of a tag. `H` maps from the tag's centre.
void add_candidates(const cv::Mat& grey, const AprilGrid& board, const PlacedQuad& tag, const Mat3& H,
                    std::vector<Candidate>& out) {
  const Vec2 centre = tag.board_centre();
  for (std::size_t k = 0; k < 4; ++k) {
    const auto predicted = map_point(H, tag.board[k] - centre);
    if (!predicted) continue;
    const Mat2 J = map_jacobian(H, tag.board[k] - centre);
    const double gap = board.spacing * std::min(J.col(0).norm(), J.col(1).norm());
    // The detector's own corner where it agrees with the neighbourhood; it is nearer than a plane is to a
    // wide lens.
    const bool agree = (tag.px[k] - *predicted).norm() < 0.5 * gap;
    add_candidate(grey, board, tag, k, H, centre, agree ? Vec2((tag.px[k] + *predicted) / 2) : *predicted,
                  out);
  }
}

struct Refined {
  int point;
  Vec2 board, px;
  double sigma;
};

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

/// The local map from board points relative to `at`, by the twelve refined corners nearest to it (`skip` is
/// not one).
std::optional<Mat3> plane_of_refined(const std::vector<Refined>& all, const Vec2& at, int skip,
                                     double tag_px) {
  std::vector<const Refined*> near;
  for (const Refined& r : all)
    if (r.point != skip) near.push_back(&r);
  const std::size_t n = std::min<std::size_t>(near.size(), 12);
  const auto nearer = [&](const Refined* a, const Refined* b) {
    const double da = (a->board - at).squaredNorm(), db = (b->board - at).squaredNorm();
    return da != db ? da < db : a->point < b->point;
  };
  std::partial_sort(near.begin(), near.begin() + static_cast<long>(n), near.end(), nearer);
  std::vector<Vec2> from, to;
  for (std::size_t i = 0; i < n; ++i) {
    from.push_back(near[i]->board - at);
    to.push_back(near[i]->px);
  }
  return fit_plane(from, to, 0.03 * tag_px);
}

/// Distance of each corner from where its neighbours put it [px].
std::vector<double> stray_distances(const std::vector<Refined>& corners, double tag_px) {
  std::vector<double> out;
  for (const Refined& r : corners) {
    const auto H = plane_of_refined(corners, r.board, r.point, tag_px);
    const auto predicted = H ? map_point(*H, Vec2(0, 0)) : std::nullopt;
    out.push_back(predicted ? (*predicted - r.px).norm() : 1e9);
  }
  return out;
}

/// What a lens of strong distortion bends between neighbours is in the median; strays stand out from it.
double stray_limit(std::vector<double> distances) {
  if (distances.empty()) return 0;
  const auto middle = distances.begin() + static_cast<long>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  return std::max(0.4, 5 * *middle);
}

/// Without strays; then those that had a bad start, or none, again from where their good neighbours say.
std::vector<Refined> without_strays(const cv::Mat& grey, const AprilGrid& board,
                                    const std::vector<PlacedQuad>& quads, const std::vector<int>& tags,
                                    const std::vector<Refined>& first, double tag_px, double noise) {
  const std::vector<double> distance = stray_distances(first, tag_px);
  const double limit = stray_limit(distance);
  std::vector<Refined> good;
  for (std::size_t i = 0; i < first.size(); ++i)
    if (distance[i] <= limit) good.push_back(first[i]);
  std::vector<Candidate> again;
  for (int i : tags) {
    const PlacedQuad& tag = quads[static_cast<std::size_t>(i)];
    for (std::size_t k = 0; k < 4; ++k) {
      const int point = (tag.id - board.first_id) * 4 + static_cast<int>(k);
      if (std::any_of(good.begin(), good.end(), [&](const Refined& r) { return r.point == point; })) continue;
      const auto H = plane_of_refined(good, tag.board[k], point, tag_px);
      const auto start = H ? map_point(*H, Vec2(0, 0)) : std::nullopt;
      if (start) add_candidate(grey, board, tag, k, *H, tag.board[k], *start, again);
    }
  }
  std::vector<Refined> all = good;
  for (const Refined& r : refine(grey, again, noise)) {
    const auto H = plane_of_refined(good, r.board, r.point, tag_px);
    const auto predicted = H ? map_point(*H, Vec2(0, 0)) : std::nullopt;
    if (predicted && (*predicted - r.px).norm() <= limit) all.push_back(r);
  }
  return all;
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
  const double noise = noise_level(grey, bounding_box(px, grey));
  const auto refined = refine(grey, candidates, noise);
  for (const Refined& r : without_strays(grey, board, quads, consistent.index, refined, tag_px, noise)) {
    out.corners.push_back({r.point, r.px, r.sigma});
  }
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
