// SPDX-License-Identifier: Apache-2.0
#include "detect/charuco_read.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <map>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

constexpr double kLeastStep = 5;  ///< [grey levels] between a marker's border and the ring around it
constexpr double kBorderShare =
    0.85;  ///< of the border's modules and of the ring that have to be on their side
constexpr double kLeastScore = 0.55, kNearBest = 0.12;  ///< of a guess
constexpr double kClearScore = 0.8, kClearLead = 0.18;  ///< over the second guess
constexpr std::size_t kMostGuesses = 6;
constexpr double kLooseWeight = 0.35;  ///< of a square that agrees but is not clear
constexpr double kLeastWeight = 2;     ///< of a placement
constexpr double kLeastShare = 0.3;    ///< of the squares that look like markers
constexpr double kMostOpposed = 0.4;   ///< of those that agree
/// Markers that go on where the board ends: a larger one, of which this board would be a part.
constexpr int kFewBeyond = 2;
constexpr double kMostBeyond = 0.12;
constexpr double kMostRival = 0.6;  ///< weight of the second placement

/// The square between four places of a grid; its own coordinates run from 0 to 1.
struct Square {
  std::array<Vec2, 4> px;  ///< (0, 0), (1, 0), (0, 1), (1, 1)
  Vec2 at(double u, double v) const {
    return (1 - v) * ((1 - u) * px[0] + u * px[1]) + v * ((1 - u) * px[2] + u * px[3]);
  }
};

std::optional<Square> square_at(const ChessGrid& grid, int c, int r, const cv::Mat& grey) {
  const auto a = grid.get(c, r), b = grid.get(c + 1, r), d = grid.get(c, r + 1), e = grid.get(c + 1, r + 1);
  if (!a || !b || !d || !e) return std::nullopt;
  for (const Vec2& p : {*a, *b, *d, *e}) {
    if (p.x() < -1 || p.y() < -1 || p.x() > grey.cols || p.y() > grey.rows) return std::nullopt;
  }
  return Square{{*a, *b, *d, *e}};
}

struct Levels {
  double ring = 0, border = 0;
};

/// The grey levels of the ring around a marker and of its border; nullopt where the square holds none.
std::optional<Levels> levels_of(const cv::Mat& grey, const Square& square, double margin, int modules) {
  const int n = modules + 2;
  const double module = (1 - 2 * margin) / n, in = margin + 0.5 * module, out = 0.5 * margin;
  std::vector<double> ring, border;
  Levels levels;
  const auto update = [&] {
    levels = {};
    for (const double g : ring) levels.ring += g / static_cast<double>(ring.size());
    for (const double g : border) levels.border += g / static_cast<double>(border.size());
    return std::abs(levels.ring - levels.border) >= kLeastStep;
  };
  for (int i = 0; i < n; ++i) {
    const double t = margin + ((i + n / 2) % n + 0.5) * module;  // the middle of a side first
    for (const auto& [u, v] : {std::pair{0, 1}, {1, 0}, {0, -1}, {-1, 0}}) {
      const auto place = [&](int side, double inset) { return side == 0 ? t : side > 0 ? 1 - inset : inset; };
      ring.push_back(sample(grey, square.at(place(u, out), place(v, out))));
      border.push_back(sample(grey, square.at(place(u, in), place(v, in))));
    }
    if (i == 0 && !update()) return std::nullopt;  // most squares of other things
  }
  if (!update()) return std::nullopt;
  const double step = levels.ring - levels.border, middle = (levels.ring + levels.border) / 2;
  const auto is_ring = [&](double g) { return (g - middle) / step > 0; };
  const auto n_ring = std::count_if(ring.begin(), ring.end(), is_ring);
  const auto n_border = std::count_if(border.begin(), border.end(), [&](double g) { return !is_ring(g); });
  const double least = kBorderShare * static_cast<double>(ring.size());
  if (static_cast<double>(n_ring) < least || static_cast<double>(n_border) < least) return std::nullopt;
  return levels;
}

/// Mean grey level of each module inside the border, row by row.
std::vector<double> module_levels(const cv::Mat& grey, const Square& square, double margin, int modules) {
  std::vector<double> out;
  const double module = (1 - 2 * margin) / (modules + 2);
  for (int y = 0; y < modules; ++y) {
    for (int x = 0; x < modules; ++x) {
      double sum = 0;
      for (const double dy : {0.25, 0.5, 0.75}) {
        for (const double dx : {0.25, 0.5, 0.75})
          sum += sample(grey, square.at(margin + (x + 1 + dx) * module, margin + (y + 1 + dy) * module));
      }
      out.push_back(sum / 9);
    }
  }
  return out;
}

/// Which of the board's markers the levels look like, by their correlation with the codes.
std::vector<MarkerGuess> guesses_of(const std::vector<double>& level, bool is_negative, const Charuco& board,
                                    const MarkerCodes& codes) {
  const double n = static_cast<double>(level.size());
  double mean = 0, square = 0;
  for (const double g : level) mean += g / n;
  for (const double g : level) square += (g - mean) * (g - mean);
  std::vector<MarkerGuess> out;
  if (square < n) return out;  // a grey level of contrast
  const int first = board.first_id,
            last = std::min(first + board.columns * board.rows / 2, static_cast<int>(codes.code.size()));
  for (int id = first; id < last; ++id) {
    for (int turn = 0; turn < 4; ++turn) {
      double sum = 0;
      const std::uint64_t code = codes.code[static_cast<std::size_t>(id)][static_cast<std::size_t>(turn)];
      for (std::uint64_t rest = code; rest != 0; rest &= rest - 1)
        sum += level[static_cast<std::size_t>(std::countr_zero(rest))] - mean;
      const double white = std::popcount(code);
      const double score = (is_negative ? -1 : 1) * sum / std::sqrt(square * white * (1 - white / n));
      if (score > kLeastScore) out.push_back({id, turn, score});
    }
  }
  std::stable_sort(out.begin(), out.end(),
                   [](const MarkerGuess& a, const MarkerGuess& b) { return a.score > b.score; });
  return out;
}

std::optional<ReadSquare> read(const cv::Mat& grey, const Square& square, const Charuco& board,
                               const MarkerBook& book) {
  const MarkerCodes& codes = book.codes;
  const double margin = (1 - board.marker_m / board.square_m) / 2;
  const auto levels = levels_of(grey, square, margin, codes.modules);
  if (!levels) return std::nullopt;
  ReadSquare out;
  out.is_negative = levels->ring < levels->border;
  const auto level = module_levels(grey, square, margin, codes.modules);
  std::uint64_t code = 0;
  for (std::size_t k = 0; k < level.size(); ++k) {
    if ((level[k] > (levels->ring + levels->border) / 2) != out.is_negative) code |= std::uint64_t{1} << k;
  }
  const auto found = book.marker.find(code);
  const int last_id = board.first_id + board.columns * board.rows / 2 - 1;
  const auto is_ours = [&](const MarkerGuess& g) { return g.id >= board.first_id && g.id <= last_id; };
  if (found == book.marker.end() || !is_ours(found->second))
    out.guesses = guesses_of(level, out.is_negative, board, codes);
  // Large dictionaries have codes that a blurred marker of the board can be taken for.
  const bool looks_ours = !out.guesses.empty() && out.guesses[0].score > kClearScore;
  if (found != book.marker.end() && !looks_ours) {
    out.guesses = {found->second};
    out.is_clear = true;
    return out;
  }
  const double lead = out.guesses.size() < 2 ? 1 : out.guesses[0].score - out.guesses[1].score;
  out.is_clear = looks_ours && lead > kClearLead;
  while (!out.guesses.empty() &&
         (out.guesses.size() > kMostGuesses || out.guesses.back().score < out.guesses[0].score - kNearBest))
    out.guesses.pop_back();
  return out;
}

/// (x, y) turned by quarter turns.
std::pair<int, int> turned(int x, int y, int turn) {
  for (int k = 0; k < turn; ++k) x = std::exchange(y, x), x = -x;
  return {x, y};
}

/// Columns and rows of the squares with markers, by id from the board's first.
std::vector<std::pair<int, int>> marker_squares(const Charuco& board, bool is_legacy) {
  std::vector<std::pair<int, int>> out;
  for (int r = 0; r < board.rows; ++r) {
    for (int c = 0; c < board.columns; ++c) {
      if (((c + r) % 2 == 0) == is_legacy) out.emplace_back(c, r);
    }
  }
  return out;
}

/// The board's square on which a lattice's square lies, before the shift.
std::pair<int, int> unshifted_square(const ReadSquare& s, int turn) {
  const auto [x, y] = turned(2 * s.c + 1, 2 * s.r + 1, turn);
  return {(x + 1) / 2, (y + 1) / 2};  // both are odd
}

using Key = std::tuple<bool, int, int, int>;  ///< negative, turn, shifts

std::map<Key, double> votes_of(const std::vector<ReadSquare>& squares, const Charuco& board,
                               const std::vector<std::pair<int, int>>& places) {
  std::map<Key, double> out;
  for (const ReadSquare& s : squares) {
    for (std::size_t k = 0; k < s.guesses.size(); ++k) {
      const MarkerGuess& g = s.guesses[k];
      const int i = g.id - board.first_id;
      if (i < 0 || i >= static_cast<int>(places.size())) continue;
      const auto [c, r] = unshifted_square(s, g.turn);
      const auto [to_c, to_r] = places[static_cast<std::size_t>(i)];
      out[{s.is_negative, g.turn, to_c - c, to_r - r}] += s.is_clear && k == 0 ? 1 : kLooseWeight;
    }
  }
  return out;
}

}  // namespace

std::pair<int, int> BoardPlacement::corner_of(int c, int r) const {
  const auto [x, y] = turned(c, r, turn);
  return {x + shift_c, y + shift_r};
}

MarkerBook marker_book(std::string_view dictionary) {
  MarkerBook out{marker_codes(dictionary), {}};
  for (std::size_t id = 0; id < out.codes.code.size(); ++id) {
    for (std::size_t turn = 0; turn < 4; ++turn)
      out.marker.try_emplace(out.codes.code[id][turn],
                             MarkerGuess{static_cast<int>(id), static_cast<int>(turn), 1});
  }
  return out;
}

std::vector<ReadSquare> read_squares(const cv::Mat& grey, const SeenLattice& lattice, const Charuco& board,
                                     const MarkerBook& book) {
  std::vector<ReadSquare> out;
  for (int r = 0; r + 1 < lattice.grid.rows; ++r) {
    for (int c = 0; c + 1 < lattice.grid.columns; ++c) {
      const auto square = square_at(lattice.grid, c, r, grey);
      auto found = square ? read(grey, *square, board, book) : std::nullopt;
      if (!found) continue;
      found->c = c, found->r = r;
      out.push_back(std::move(*found));
    }
  }
  return out;
}

BoardPlacement place_on_board(const std::vector<ReadSquare>& squares, const Charuco& board, bool is_legacy) {
  const auto places = marker_squares(board, is_legacy);
  const auto votes = votes_of(squares, board, places);
  BoardPlacement out;
  out.is_legacy = is_legacy;
  const auto best = std::max_element(votes.begin(), votes.end(),
                                     [](const auto& a, const auto& b) { return a.second < b.second; });
  if (best == votes.end()) return out;
  std::tie(out.is_negative, out.turn, out.shift_c, out.shift_r) = best->first;
  double rival = 0;
  for (auto v = votes.begin(); v != votes.end(); ++v) rival = v == best ? rival : std::max(rival, v->second);
  for (const ReadSquare& s : squares) {
    auto [c, r] = unshifted_square(s, out.turn);
    c += out.shift_c, r += out.shift_r;
    const auto at = std::find(places.begin(), places.end(), std::pair{c, r});
    const int id = at == places.end() ? -1 : board.first_id + static_cast<int>(at - places.begin());
    const bool agrees = s.is_negative == out.is_negative &&
                        std::any_of(s.guesses.begin(), s.guesses.end(),
                                    [&](const auto& g) { return g.id == id && g.turn == out.turn; });
    out.agreeing += agrees ? 1 : 0;
    if (agrees || !s.is_clear) continue;
    ++out.opposed;
    if (c < 0 || r < 0 || c >= board.columns || r >= board.rows) ++out.beyond;
  }
  out.weight = best->second;
  out.is_sure = out.weight >= kLeastWeight && rival <= kMostRival * out.weight &&
                out.opposed <= kMostOpposed * out.agreeing &&
                (out.beyond < kFewBeyond || out.beyond < kMostBeyond * out.agreeing) &&
                out.agreeing >= kLeastShare * static_cast<double>(squares.size());
  return out;
}

}  // namespace plumbline::detail
