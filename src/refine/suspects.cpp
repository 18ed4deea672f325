// SPDX-License-Identifier: Apache-2.0
#include "refine/suspects.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "plumbline/core/parallel.hpp"

namespace plumbline::detail {
namespace {

constexpr int kNeighbours = 16;
constexpr std::size_t kLeastCorners = 12;
constexpr int kRounds = 12;               // of weighted least squares, towards least absolute errors
constexpr double kMedianLength = 1.1774;  // of a two-dimensional Gaussian error, in standard deviations
constexpr double kShareOfSpacing = 0.1, kSigmas = 6, kMostSuspects = 0.4;

// Where the target's points lie in their plane; nullopt when that is not a plane of constant z.
std::optional<std::vector<Vec2>> in_plane(const Target& target, const View& view) {
  std::vector<Vec2> list;
  for (const Corner& c : view.corners) {
    const Vec3& p = target.points[c.point];
    if (std::abs(p.z() - target.points[view.corners.front().point].z()) > 1e-12) return std::nullopt;
    list.push_back(p.head<2>());
  }
  return list;
}

// Monomials of (u, v) up to the degree: n = (degree + 1)(degree + 2) / 2 of them.
template <int N>
std::array<double, N> monomials(double u, double v) {
  std::array<double, N> m;
  int k = 0;
  for (int degree = 0; k < N; ++degree) {
    for (int j = 0; j <= degree; ++j, ++k) {
      double value = 1;
      for (int i = 0; i < degree - j; ++i) value *= u;
      for (int i = 0; i < j; ++i) value *= v;
      m[k] = value;
    }
  }
  return m;
}

// Weighted least squares of both pixel coordinates by normal equations; the coordinates (u, v) are of order
// one. false when the points do not determine the polynomial.
template <int N>
class Polynomial {
 public:
  void add(const std::array<double, N>& m, const Vec2& px, double w) {
    for (int i = 0; i < N; ++i) {
      for (int j = 0; j <= i; ++j) A_[i][j] += w * m[i] * m[j];
      b_[0][i] += w * m[i] * px.x();
      b_[1][i] += w * m[i] * px.y();
    }
  }
  bool solve() {  // Cholesky in place
    for (int j = 0; j < N; ++j) {
      const double diagonal = A_[j][j];
      for (int k = 0; k < j; ++k) A_[j][j] -= A_[j][k] * A_[j][k];
      if (!(A_[j][j] > 1e-10 * diagonal)) return false;
      A_[j][j] = std::sqrt(A_[j][j]);
      for (int i = j + 1; i < N; ++i) {
        for (int k = 0; k < j; ++k) A_[i][j] -= A_[i][k] * A_[j][k];
        A_[i][j] /= A_[j][j];
      }
    }
    for (auto& x : b_) {
      for (int i = 0; i < N; ++i) {
        for (int k = 0; k < i; ++k) x[i] -= A_[i][k] * x[k];
        x[i] /= A_[i][i];
      }
      for (int i = N - 1; i >= 0; --i) {
        for (int k = i + 1; k < N; ++k) x[i] -= A_[k][i] * x[k];
        x[i] /= A_[i][i];
      }
    }
    return true;
  }
  Vec2 at(const std::array<double, N>& m) const {
    Vec2 px = Vec2::Zero();
    for (int i = 0; i < N; ++i) px += m[i] * Vec2(b_[0][i], b_[1][i]);
    return px;
  }

 private:
  std::array<std::array<double, N>, N> A_{};
  std::array<std::array<double, N>, 2> b_{};
};

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// How far each corner is from one smooth surface over the whole board; empty where the corners do not
// determine it. \param n_rounds  1: least squares; more: least absolute errors
// \tparam N  terms of the polynomial
template <int N>
std::vector<double> off_surface(const View& view, const std::vector<Vec2>& board, int n_rounds) {
  if (board.size() < 3 * N) return {};
  Vec2 low = board[0], high = board[0];
  for (const Vec2& p : board) low = low.cwiseMin(p), high = high.cwiseMax(p);
  const Vec2 middle = 0.5 * (low + high);
  const double half = 0.5 * (high - low).maxCoeff();
  std::vector<std::array<double, N>> m;
  for (const Vec2& p : board) {
    const Vec2 u = (p - middle) / half;
    m.push_back(monomials<N>(u.x(), u.y()));
  }
  std::vector<double> off(board.size()), w(board.size(), 1.0);
  for (int round = 0; round < n_rounds; ++round) {
    Polynomial<N> surface;
    for (std::size_t i = 0; i < board.size(); ++i) surface.add(m[i], view.corners[i].px, w[i]);
    if (!surface.solve()) return {};
    for (std::size_t i = 0; i < board.size(); ++i) {
      off[i] = (surface.at(m[i]) - view.corners[i].px).norm();
      w[i] = 1 / (off[i] + 0.1);
    }
  }
  return off;
}

struct Judged {
  double off_px = 0, spacing_px = 0;
};

// How far corner `i` is from what its neighbours say (those in `without` are not asked), and the typical
// distance of corners as near to one another as the nearest are.
Judged judge(const View& view, const std::vector<Vec2>& board, std::size_t i,
             const std::vector<bool>& without) {
  std::vector<std::pair<double, std::size_t>> near;
  for (std::size_t j = 0; j < board.size(); ++j) {
    if (j != i && !without[j]) near.emplace_back((board[j] - board[i]).squaredNorm(), j);
  }
  const auto n = std::min<std::size_t>(kNeighbours, near.size());
  std::partial_sort(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(n), near.end());
  near.resize(n);
  const double reach = std::sqrt(near.back().first), step = std::sqrt(near.front().first);
  std::vector<std::array<double, 6>> m;
  std::vector<double> scales;  // pixels for a step on the board
  for (const auto& [d2, j] : near) {
    const Vec2 u = (board[j] - board[i]) / reach;
    m.push_back(monomials<6>(u.x(), u.y()));
    const auto& [e2, k] = near[scales.size() + 1 < n ? scales.size() + 1 : 0];
    const double between = (board[j] - board[k]).norm();
    scales.push_back((view.corners[j].px - view.corners[k].px).norm() / between * step);
  }
  const double spacing = median(scales);
  std::vector<double> w(n, 1.0);
  Vec2 predicted = view.corners[i].px;
  for (int round = 0; round < kRounds; ++round) {
    Polynomial<6> p;
    for (std::size_t k = 0; k < n; ++k) p.add(m[k], view.corners[near[k].second].px, w[k]);
    if (!p.solve()) return {0, spacing};  // neighbours on two lines: nothing can be said
    predicted = p.at(monomials<6>(0, 0));
    // Least absolute errors by weights: 1 / |error|.
    for (std::size_t k = 0; k < n; ++k)
      w[k] = 1 / ((p.at(m[k]) - view.corners[near[k].second].px).norm() + 1e-3 * spacing);
  }
  return {(predicted - view.corners[i].px).norm(), spacing};
}

bool too_many(const std::vector<bool>& suspects) {
  const auto n = std::count(suspects.begin(), suspects.end(), true);
  return static_cast<double>(n) > kMostSuspects * static_cast<double>(suspects.size());
}

}  // namespace

std::vector<bool> suspect_corners(const Target& target, const View& view) {
  std::vector<bool> suspects(view.corners.size(), false);
  if (view.corners.size() < kLeastCorners || !target.is_planar) return suspects;
  const auto board = in_plane(target, view);
  if (!board) return suspects;
  // Neighbours in the list are mostly neighbours on the board.
  std::vector<double> steps;
  for (std::size_t i = 1; i < board->size(); ++i)
    steps.push_back((view.corners[i].px - view.corners[i - 1].px).norm());
  const double step = median(steps);
  const std::vector<double> smooth = off_surface<15>(view, *board, 1);
  const auto is_small = [&](double off) { return off < 0.5 * kShareOfSpacing * step; };
  if (!smooth.empty() && std::all_of(smooth.begin(), smooth.end(), is_small)) return suspects;
  // A whole row that is wrong agrees with itself: only the whole board tells. Of eight rows the first one
  // bends a polynomial of second degree only at 2.2 times the cost (in absolute errors) of leaving it out;
  // one of fourth degree would follow it.
  const std::vector<double> off_board = off_surface<6>(view, *board, kRounds);
  for (std::size_t i = 0; i < off_board.size(); ++i)
    suspects[i] = off_board[i] > std::max(step, kSigmas * median(off_board) / kMedianLength);
  // Twice, the second time without what the first one found: a right corner among wrong ones is no suspect.
  for (int pass = 0; pass < 2; ++pass) {
    if (too_many(suspects)) break;
    std::vector<Judged> judged;
    std::vector<double> off;
    for (std::size_t i = 0; i < board->size(); ++i) {
      judged.push_back(judge(view, *board, i, suspects));
      off.push_back(judged.back().off_px);
    }
    const double sigma = median(off) / kMedianLength;
    for (std::size_t i = 0; i < board->size(); ++i)
      suspects[i] = judged[i].off_px > std::max(kSigmas * sigma, kShareOfSpacing * judged[i].spacing_px);
  }
  if (too_many(suspects)) suspects.assign(suspects.size(), false);
  return suspects;
}

Dataset without_suspects(const Dataset& data, int n_threads) {
  Dataset sound = data;
  parallel_for(static_cast<int>(sound.views.size()), n_threads, [&](int v) {
    View& view = sound.views[static_cast<std::size_t>(v)];
    const std::vector<bool> suspects = suspect_corners(data.targets[view.target], view);
    std::size_t i = 0;
    std::erase_if(view.corners, [&](const Corner&) { return suspects[i++]; });
  });
  return sound;
}

}  // namespace plumbline::detail
