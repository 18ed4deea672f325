// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <map>
#include <set>

#include "detect/bends.hpp"
#include "detect/charuco.hpp"
#include "detect/finders.hpp"
#include "detect/planar.hpp"
#include "detect/strays.hpp"
#include "detect/subpixel.hpp"
#include "detect/tag_bits.hpp"

namespace plumbline::detail {
namespace {

constexpr int kMinTags = 2;             ///< read, and where the other says
constexpr double kMinAgreeing = 0.6;    ///< of the board's tags seen: that lie as on the board
constexpr double kMostOthers = 0.3;     ///< tags with other bits than their place has, to those that agree
constexpr double kSearch = 0.2;         ///< [tags] see look_around
constexpr double kAsGood = 0.8;         ///< of the best contrast
constexpr double kReach = 1.05;         ///< [tags] of what is known, to what is next to it
constexpr int kMostTries = 2;           ///< at a corner, as more of those around it become known
constexpr std::size_t kFewCorners = 8;  ///< too few to say which of them is wrong
/// A corner that is so much less sure than most is seen through glare or lies on a shadow's edge, and may be
/// wrong by more than its sigma; it stays where those around it say the same.
constexpr double kUnclear = 6, kUnclearPx = 0.04, kSamePx = 0.6;
constexpr int kMinModules = 12;    ///< in the image, for a tag to have a say
constexpr double kAgree = 0.1;     ///< share of a tag's modules that may differ
constexpr double kMinClean = 1.6;  ///< [px] beside an edge, see add_candidate

/// Corner k of a tag in units of the tag's size, Kalibr's axes (y up), counted from point 0.
Vec2 corner_of(const AprilGrid& board, int tag, std::size_t k) {
  return Vec2(tag % board.columns, tag / board.columns) * (1 + board.spacing) +
         Vec2(k == 1 || k == 2 ? 1 : 0, k >= 2 ? 1 : 0);
}

std::vector<PlacedQuad> place(const AprilGrid& board, const std::vector<Marker>& tags) {
  std::vector<PlacedQuad> out;
  for (const Marker& tag : tags) {
    const int t = tag.id - board.first_id;
    if (t < 0 || t >= board.columns * board.rows) continue;
    PlacedQuad quad{tag.id, {}, tag.px};
    for (std::size_t k = 0; k < 4; ++k) quad.board[k] = corner_of(board, t, k);
    out.push_back(quad);
  }
  return out;
}

/// Of the black border [tags].
double border_width(const AprilGrid& board) {
  return static_cast<double>(board.border) / (april_book(board.family)->n + 2 * board.border);
}

/// The board with the border that most of its tags have.
AprilGrid with_border_seen(AprilGrid board, const std::vector<Marker>& tags) {
  const auto n =
      std::count_if(tags.begin(), tags.end(), [&](const Marker& m) { return m.border == board.border; });
  if (2 * n < static_cast<long>(tags.size())) board.border = 3 - board.border;
  return board;
}

struct Candidate {
  int point;
  Vec2 board;
  CornerStart start;
};

/// Where the four fields alternate best around a foretold corner, up to kSearch [tags] from it: a wide lens
/// puts corners pixels away from where those beside them say. u, v reach into the fields.
Vec2 look_around(const cv::Mat& grey, const Vec2& start, const Mat2& J, const Vec2& u, const Vec2& v) {
  constexpr int kSteps = 3;
  constexpr int kPlaces = 2 * kSteps + 1;
  std::array<double, kPlaces * kPlaces> contrast{};
  const auto place = [&](int i) {
    return Vec2(start + J * Vec2(i % kPlaces - kSteps, i / kPlaces - kSteps) * (kSearch / kSteps));
  };
  double best = 0;
  for (int i = 0; i < kPlaces * kPlaces; ++i) {
    contrast[static_cast<std::size_t>(i)] = saddle_contrast(grey, place(i), u, v);
    best = std::min(best, contrast[static_cast<std::size_t>(i)]);
  }
  // It is flat about the corner: the middle of what is about as good.
  Vec2 sum = Vec2::Zero();
  int n = 0;
  for (int i = 0; i < kPlaces * kPlaces; ++i) {
    if (contrast[static_cast<std::size_t>(i)] > kAsGood * best) continue;
    sum += place(i);
    ++n;
  }
  return n > 0 && best < 0 ? Vec2(sum / n) : start;
}

/// A start for corner k of a tag at `start`, unless the picture there is no corner of a tag. J: d px / d
/// board.
void add_candidate(const cv::Mat& grey, const AprilGrid& board, int tag, std::size_t k, const Mat2& J,
                   Vec2 start, bool is_foretold, std::vector<Candidate>& out) {
  const double height = narrow_height(J), gap = board.spacing * height;
  // Inside the tag's border and inside the small square (`spacing` wide) it is black, beside them white.
  const double clean = std::min(border_width(board), board.spacing);
  // Narrower than that and the edge is not told from the border's other edge.
  if (clean * height < kMinClean) return;
  const Vec2 u = J.col(0) * (0.5 * clean), v = J.col(1) * (k % 2 == 0 ? 0.5 * clean : -0.5 * clean);
  if (is_foretold) start = look_around(grey, start, J, u, v);
  if (saddle_contrast(grey, start, u, v) > -8) return;
  SaddleWindow window{J};
  window.leak_blurs = 2;  // the small squares are close by
  window.across = clean;
  window.max_move_px = std::max(1.5, 0.5 * gap);
  // Into the tag its own edge runs on; the other way the small square ends with the gap.
  const bool tag_is_right = k == 0 || k == 3, tag_is_up = k == 0 || k == 1;
  window.low = Vec2(tag_is_right ? -board.spacing : -1, tag_is_up ? -board.spacing : -1);
  window.high = Vec2(tag_is_right ? 1 : board.spacing, tag_is_up ? 1 : board.spacing);
  out.push_back({4 * tag + static_cast<int>(k), corner_of(board, tag, k), {start, window}});
}

/// Starts for the four corners of a tag from where its saddles were seen.
void add_candidates(const cv::Mat& grey, const AprilGrid& board, const PlacedQuad& tag,
                    std::vector<Candidate>& out) {
  const auto H = plane_of(tag);
  if (!H) return;
  for (std::size_t k = 0; k < 4; ++k)
    add_candidate(grey, board, tag.id - board.first_id, k, map_jacobian(*H, tag.board[k]), tag.px[k], false,
                  out);
}

bool is_inside(const Vec2& p, const cv::Mat& grey) {
  return p.x() >= 1 && p.y() >= 1 && p.x() <= grey.cols - 2 && p.y() <= grey.rows - 2;
}

struct Found {
  std::vector<Refined> corners;
  std::map<int, SaddleWindow> windows;
  void add(const std::vector<Refined>& more, const std::vector<Candidate>& candidates) {
    corners.insert(corners.end(), more.begin(), more.end());
    for (const Candidate& c : candidates) windows[c.point] = c.start.window;
  }
};

/// 1: the tag between four corners (clockwise from its top left) is `id` as far as it is in the image; -1: it
/// is another; 0: it says nothing.
int judge(const cv::Mat& grey, const TagBook& book, const AprilGrid& board, const std::array<Vec2, 4>& px,
          int id) {
  const auto H = square_to_quad(px);
  if (!H) return 0;
  int opinion = 0;
  for (const int border : {board.border, 3 - board.border}) {
    const auto bits = threshold_cells(read_cells(grey, *H, book.n + 2 * border), border);
    if (!bits) continue;
    const int known = std::popcount(bits->is_inside), errors = count_errors(*bits, book, id, 0);
    if (known < kMinModules) continue;
    if (errors <= kAgree * known) return 1;
    if (known < book.n * book.n) continue;
    const TagReading other = match_code(*bits, book);
    if (other.errors <= most_errors(book)) opinion = -1;
  }
  return opinion;
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

std::vector<Refined> without_doubtful(std::vector<Refined> corners, double& limit) {
  if (corners.size() <= kFewCorners) return corners;
  std::vector<double> sigma;
  for (const Refined& r : corners) sigma.push_back(r.sigma);
  std::nth_element(sigma.begin(), sigma.begin() + static_cast<long>(sigma.size() / 2), sigma.end());
  const double most = std::max(kUnclear * sigma[sigma.size() / 2], kUnclearPx);
  std::vector<Refined> clear, unclear;
  for (const Refined& r : corners) (r.sigma > most ? unclear : clear).push_back(r);
  clear = without_strays(std::move(clear), limit);
  const std::vector<Refined> around = clear;
  for (const Refined& r : unclear) {
    const auto there = predict(around, r.board, r.point);
    if (there && (there->px - r.px).norm() < kSamePx) clear.push_back(r);
  }
  return clear;
}

/// Corners that were not read, or had a bad start, from where those around them say: from the tags that were
/// read to all that are in the image, also those with bits under glare or outside of it.
void grow(const cv::Mat& grey, const AprilGrid& board, double noise, double& limit, Found& found) {
  const int n_points = 4 * board.columns * board.rows;
  std::vector<int> tries(static_cast<std::size_t>(n_points), 0);
  for (int round = 0; round < 2 * (board.columns + board.rows); ++round) {
    std::vector<char> is_known(static_cast<std::size_t>(n_points), 0);
    for (const Refined& r : found.corners) is_known[static_cast<std::size_t>(r.point)] = 1;
    std::vector<Candidate> next;
    for (int point = 0; point < n_points; ++point) {
      const auto i = static_cast<std::size_t>(point);
      if (is_known[i] != 0 || tries[i] >= kMostTries) continue;
      const int tag = point / 4;
      const Vec2 at = corner_of(board, tag, i % 4);
      const auto is_near = [&](const Refined& r) { return (r.board - at).norm() < kReach; };
      if (std::none_of(found.corners.begin(), found.corners.end(), is_near)) continue;
      const auto there = predict(found.corners, at, point);
      if (!there || !is_inside(there->px, grey)) continue;
      ++tries[i];
      add_candidate(grey, board, tag, i % 4, there->J, there->px, true, next);
    }
    if (next.empty()) break;
    const std::size_t before = found.corners.size();
    found.add(refine(grey, next, noise), next);
    found.corners = without_doubtful(std::move(found.corners), limit);
    if (found.corners.size() <= before) break;
  }
}

/// What the bits of the board's tags say of the corners around them, seen whole or in part.
struct Verdict {
  int agree = 0, disagree = 0;
};

/// Reads each tag through its corners, which may be foretold where they are not seen, and drops the corners
/// of those that clearly are other tags.
Verdict read_through(const cv::Mat& grey, const AprilGrid& board, std::vector<Refined>& corners) {
  Verdict out;
  const TagBook& book = *april_book(board.family);
  std::map<int, const Refined*> known;
  for (const Refined& r : corners) known[r.point] = &r;
  std::vector<int> others;
  for (int tag = 0; tag < board.columns * board.rows; ++tag) {
    std::array<Vec2, 4> px;
    int n_known = 0, n_foretold = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const auto seen = known.find(4 * tag + static_cast<int>(k));
      if (seen == known.end()) continue;
      px[k] = seen->second->px;
      ++n_known;
    }
    if (n_known == 0) continue;
    for (std::size_t k = 0; k < 4; ++k) {
      if (known.contains(4 * tag + static_cast<int>(k))) continue;
      const auto there = predict(corners, corner_of(board, tag, k), -1);
      if (!there) break;
      px[k] = there->px;
      ++n_foretold;
    }
    if (n_known + n_foretold < 4) continue;
    // From the top left clockwise.
    const auto opinion = judge(grey, book, board, {px[3], px[2], px[1], px[0]}, board.first_id + tag);
    if (opinion > 0) ++out.agree;
    if (opinion < 0) ++out.disagree, others.push_back(tag);
  }
  std::erase_if(corners, [&](const Refined& r) {
    return std::find(others.begin(), others.end(), r.point / 4) != others.end();
  });
  return out;
}

}  // namespace

Detection aprilgrid_from_tags(const cv::Mat& grey, const AprilGrid& as_said,
                              const std::vector<Marker>& tags) {
  const AprilGrid board = with_border_seen(as_said, tags);
  Detection out;
  const std::vector<PlacedQuad> quads = place(board, tags);
  const ConsistentQuads consistent = consistent_quads(quads);
  const int all = board.columns * board.rows, needed = std::min(kMinTags, all);
  int n = static_cast<int>(consistent.index.size());
  std::set<int> ids;
  for (const PlacedQuad& quad : quads) ids.insert(quad.id);
  if (n < kMinAgreeing * static_cast<double>(ids.size())) {
    out.reason = fmt::format("{} of its tags seen, but only {} lie as on this board: it is another one",
                             ids.size(), n);
    return out;
  }
  std::vector<Candidate> candidates;
  std::vector<Vec2> px;
  for (int i : consistent.index) {
    const PlacedQuad& tag = quads[static_cast<std::size_t>(i)];
    add_candidates(grey, board, tag, candidates);
    px.insert(px.end(), tag.px.begin(), tag.px.end());
  }
  const double noise = noise_level(grey, bounding_box(px, grey));
  double limit = 0;
  Found found;
  found.add(refine(grey, candidates, noise), candidates);
  found.corners = without_doubtful(std::move(found.corners), limit);
  if (n > 0) grow(grey, board, noise, limit, found);
  const Verdict verdict = read_through(grey, board, found.corners);
  n = std::max(n, verdict.agree);
  if (n < needed) {
    out.reason = fmt::format("{} of {} tags found, at least {} are needed", n, all, needed);
    return out;
  }
  if (verdict.disagree > kMostOthers * n) {
    out.reason =
        fmt::format("{} tags lie as on this board, but {} others stand between them", n, verdict.disagree);
    return out;
  }
  refit_bent(grey, noise, found.windows, found.corners);
  for (const Refined& r : found.corners) out.corners.push_back({r.point, r.px, r.sigma});
  std::sort(out.corners.begin(), out.corners.end(),
            [](const Corner& a, const Corner& b) { return a.point < b.point; });
  if (out.corners.size() < 4) {
    out.reason = fmt::format("{} of {} tags found, but only {} of their corners are clear", n, all,
                             out.corners.size());
    out.corners.clear();
    return out;
  }
  out.method = "tags between saddles, saddle fit";
  return out;
}

Detection detect_aprilgrid(const cv::Mat& grey, const AprilGrid& board) {
  // What is missing then grows from what was found.
  const auto is_enough = [&](const std::vector<Marker>& tags) {
    return 2 * consistent_quads(place(board, tags)).index.size() >=
           static_cast<std::size_t>(board.columns * board.rows);
  };
  return aprilgrid_from_tags(
      grey, board, find_april_tags(grey, board.family, board.border, board.columns * board.rows, is_enough));
}

}  // namespace plumbline::detail
