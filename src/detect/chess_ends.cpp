// SPDX-License-Identifier: Apache-2.0
#include "detect/chess_ends.hpp"

#include <algorithm>
#include <cmath>

#include "detect/median.hpp"
#include "detect/saddle_fit.hpp"
#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

constexpr double kNear = 0.2;  ///< of a step: how far a corner beyond an end may lie from its place
/// What a corner beyond may leave of the contrast, by what those of the board leave (markers inside of
/// squares).
constexpr double kLeastMisfit = 0.2, kMostMisfit = 0.9, kMoreMisfit = 2.5;
constexpr double kAlike = 0.6;           ///< of the board's median contrast
constexpr double kSeemsAlike = 0.4;      ///< of it, by four grey levels alone
constexpr double kMostGoOn = 0.5;        ///< share of a side's corners that may seem to have one beside them
constexpr double kBeyondPx = 6;          ///< of the image's border: too near to look for a corner
constexpr double kMostUneven = 1.7;      ///< ratio of neighbouring steps; a fisheye's rim reaches 1.5
constexpr double kLeastStraight = 0.85;  ///< cosine between them
constexpr double kMostBreaks = 0.1;      ///< share of places where it is otherwise

int colour(int c, int r) { return (c + r) % 2 == 0 ? 1 : -1; }

/// One step beyond a corner.
std::optional<Vec2> beyond(const ChessGrid& grid, int c, int r, int dc, int dr) {
  const auto end = grid.get(c, r), before = grid.get(c - dc, r - dr),
             earlier = grid.get(c - 2 * dc, r - 2 * dr);
  if (!end || !before) return std::nullopt;
  const Vec2 step = *end - *before;
  return Vec2(*end + step + (earlier ? Vec2(0.7 * (step - (*before - *earlier))) : Vec2(0, 0)));
}

}  // namespace

bool has_kept_its_rims(const ChessGrid& before, const ChessGrid& after) {
  const auto on_line = [](const ChessGrid& grid, bool is_column, int at) {
    int n = 0;
    for (int k = 0; k < (is_column ? grid.rows : grid.columns); ++k)
      n += (is_column ? grid.at(at, k) : grid.at(k, at)) ? 1 : 0;
    return n;
  };
  for (const bool is_column : {false, true}) {
    const int lines = is_column ? before.columns : before.rows;
    int first = 0, last = lines - 1;
    while (first < last && on_line(before, is_column, first) == 0) ++first;
    while (last > first && on_line(before, is_column, last) == 0) --last;
    for (const int at : {first, last}) {
      if (2 * on_line(after, is_column, at) < on_line(before, is_column, at)) return false;
    }
  }
  return true;
}

bool goes_on(const cv::Mat& grey, const ChessGrid& grid, const std::vector<ChessCorner>& corners,
             double noise) {
  std::vector<double> contrasts;
  for (const ChessCorner& c : corners)
    contrasts.push_back(c.contrast * colour(c.point % grid.columns, c.point / grid.columns));
  if (contrasts.empty()) return false;
  const double usual = median(std::move(contrasts));
  std::vector<double> misfits;
  for (const ChessCorner& c : corners) misfits.push_back(c.misfit);
  const double most_misfit = std::clamp(kMoreMisfit * median(std::move(misfits)), kLeastMisfit, kMostMisfit);
  for (const auto& [dc, dr] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
    int asked = 0, there = 0;
    for (int k = 0; k < (dc != 0 ? grid.rows : grid.columns); ++k) {
      const int c = dc > 0 ? grid.columns - 1 : dc < 0 ? 0 : k, r = dr > 0 ? grid.rows - 1 : dr < 0 ? 0 : k;
      const auto at = beyond(grid, c, r, dc, dr);
      const auto J = at ? steps_at(grid, c, r) : std::nullopt;
      if (!J || at->x() < kBeyondPx || at->y() < kBeyondPx || at->x() > grey.cols - 1 - kBeyondPx ||
          at->y() > grey.rows - 1 - kBeyondPx)
        continue;
      ++asked;
      const double here = saddle_contrast(grey, *at, 0.3 * J->col(0), 0.3 * J->col(1)) / 2;
      if (here * colour(c + dc, r + dr) / usual < kSeemsAlike) continue;
      SaddleWindow window{*J};
      window.max_misfit = most_misfit;
      window.max_move_px = kNear * std::min(J->col(0).norm(), J->col(1).norm());
      const auto fit = fit_saddle(grey, *at, window, noise);
      there += fit && fit->contrast * colour(c + dc, r + dr) / usual > kAlike ? 1 : 0;
    }
    if (asked >= 3 && there > kMostGoOn * asked) return true;
  }
  return false;
}

bool has_even_steps(const ChessGrid& grid) {
  int uneven = 0, all = 0;
  for (const auto& [dc, dr] : {std::pair{1, 0}, {0, 1}}) {
    for (int r = 0; r < grid.rows; ++r) {
      for (int c = 0; c < grid.columns; ++c) {
        const auto a = grid.get(c - dc, r - dr), b = grid.get(c, r), d = grid.get(c + dc, r + dr);
        if (!a || !b || !d) continue;
        const Vec2 one = *b - *a, two = *d - *b;
        ++all;
        const bool is_even = one.norm() < kMostUneven * two.norm() && two.norm() < kMostUneven * one.norm() &&
                             one.dot(two) > kLeastStraight * one.norm() * two.norm();
        uneven += is_even ? 0 : 1;
      }
    }
  }
  return uneven <= kMostBreaks * all;
}

}  // namespace plumbline::detail
