// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <optional>

#include "detect/saddles.hpp"

namespace plumbline::detail {
namespace {

constexpr double kCone = 0.3;  ///< off an edge's direction that a first neighbour may lie [rad, about]
/// Of a step: how far from its foretold place a node may lie; less where two steps before it foretell it.
constexpr double kNearness = 0.3, kNearnessOfThird = 0.22;
constexpr double kMostRatio = 2;    ///< of opposite sides of a cell
constexpr int kMostLattices = 40;   ///< of one image
constexpr double kSameTurn = 0.85;  ///< cosine between the edges of neighbours

double cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Saddles by place.
class Buckets {
 public:
  explicit Buckets(const std::vector<Saddle>& saddles) : saddles_(saddles) {
    for (const Saddle& s : saddles) size_ = size_.cwiseMax(s.px);
    const double area = (size_.x() + 1) * (size_.y() + 1);
    pitch_ = std::max(4.0, std::sqrt(area / std::max<double>(1, static_cast<double>(saddles.size()))));
    nx_ = static_cast<int>(size_.x() / pitch_) + 1;
    ny_ = static_cast<int>(size_.y() / pitch_) + 1;
    cells_.resize(static_cast<std::size_t>(nx_) * ny_);
    for (std::size_t i = 0; i < saddles.size(); ++i)
      cells_[cell(saddles[i].px)].push_back(static_cast<int>(i));
  }

  /// Calls visit(index) for the saddles within `radius` of p.
  template <class Visit>
  void within(const Vec2& p, double radius, const Visit& visit) const {
    const int x0 = column(p.x() - radius, nx_), x1 = column(p.x() + radius, nx_);
    const int y0 = column(p.y() - radius, ny_), y1 = column(p.y() + radius, ny_);
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        for (const int i : cells_[static_cast<std::size_t>(y) * nx_ + x]) {
          if ((saddles_[static_cast<std::size_t>(i)].px - p).squaredNorm() <= radius * radius) visit(i);
        }
      }
    }
  }

  /// The same for the saddles near the box between two points.
  template <class Visit>
  void between(const Vec2& a, const Vec2& b, const Visit& visit) const {
    const Vec2 low = a.cwiseMin(b), high = a.cwiseMax(b);
    const int x0 = column(low.x(), nx_), x1 = column(high.x(), nx_);
    const int y0 = column(low.y(), ny_), y1 = column(high.y(), ny_);
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        for (const int i : cells_[static_cast<std::size_t>(y) * nx_ + x]) visit(i);
      }
    }
  }

  double pitch() const { return pitch_; }
  double extent() const { return std::max(size_.x(), size_.y()); }

 private:
  int column(double v, int n) const { return std::clamp(static_cast<int>(v / pitch_), 0, n - 1); }
  std::size_t cell(const Vec2& p) const {
    return static_cast<std::size_t>(column(p.y(), ny_)) * nx_ + column(p.x(), nx_);
  }
  const std::vector<Saddle>& saddles_;
  Vec2 size_ = Vec2::Zero();
  double pitch_ = 1;
  int nx_ = 1, ny_ = 1;
  std::vector<std::vector<int>> cells_;
};

/// Neighbours are about equally strong: what an image has beside the board is often fainter, seldom stronger.
constexpr double kAlike = 0.4;

bool is_alike(const Saddle& a, const Saddle& b) {
  return std::min(a.strength, b.strength) > kAlike * std::max(a.strength, b.strength);
}

/// Whether the saddles' edges run alike and their fields are opposite (neighbours) or the same (across a
/// cell).
bool matches(const Saddle& a, const Saddle& b, bool opposite) {
  if (!is_alike(a, b)) return false;
  const double same = std::min(std::abs(a.edge[0].dot(b.edge[0])), std::abs(a.edge[1].dot(b.edge[1])));
  const double swapped = std::min(std::abs(a.edge[0].dot(b.edge[1])), std::abs(a.edge[1].dot(b.edge[0])));
  // describe() puts edge[0] on one certain side of the bright field: neighbours have them exchanged.
  return (opposite ? swapped : same) > kSameTurn && (opposite ? swapped >= same : same >= swapped);
}

/// Which saddle is at (i, j); -1: none. Larger boards than this holds are not printed.
class Places {
 public:
  static bool holds(int i, int j) { return std::abs(i) <= kMost && std::abs(j) <= kMost; }
  int get(int i, int j) const { return holds(i, j) ? saddle_[index(i, j)] : -1; }
  void set(int i, int j, int saddle) { saddle_[index(i, j)] = saddle; }

 private:
  static constexpr int kMost = 200, kSide = 2 * kMost + 1;
  static std::size_t index(int i, int j) {
    return static_cast<std::size_t>(j + kMost) * kSide + static_cast<std::size_t>(i + kMost);
  }
  std::vector<int> saddle_ = std::vector<int>(static_cast<std::size_t>(kSide) * kSide, -1);
};

class Growth {
 public:
  Growth(const std::vector<Saddle>& saddles, const Buckets& buckets, cv::Size image)
      : saddles_(saddles), buckets_(buckets), image_(image), taken_(saddles.size(), 0) {}

  /// The lattice of the saddle `seed`, empty when there is no cell around it.
  std::vector<LatticeNode> from(int seed) {
    for (const LatticeNode& n : put_) {
      at_.set(n.i, n.j, -1);
      taken_[static_cast<std::size_t>(n.saddle)] = 0;
    }
    put_.clear();
    nodes_.clear();
    if (!start(seed)) return {};
    // Later nodes foretell places that the first ones could not.
    for (std::size_t before = 0; before != nodes_.size();) {
      before = nodes_.size();
      grow();
      for (const LatticeNode& n : nodes_) queue_.emplace_back(n.i, n.j);
    }
    prune();
    return nodes_;
  }

 private:
  static constexpr std::array<std::pair<int, int>, 4> kDirections{{{1, 0}, {0, 1}, {-1, 0}, {0, -1}}};

  void grow() {
    while (!queue_.empty()) {
      const auto [i, j] = queue_.front();
      queue_.pop_front();
      for (const auto& [di, dj] : kDirections) extend(i, j, di, dj);
    }
  }

  const Vec2& px(int saddle) const { return saddles_[static_cast<std::size_t>(saddle)].px; }

  std::optional<Vec2> place(int i, int j) const {
    const int found = at_.get(i, j);
    return found < 0 ? std::nullopt : std::optional<Vec2>(px(found));
  }

  void put(int i, int j, int saddle) {
    at_.set(i, j, saddle);
    nodes_.push_back({i, j, saddle});
    put_.push_back(nodes_.back());
    taken_[static_cast<std::size_t>(saddle)] = 1;
    queue_.emplace_back(i, j);
  }

  /// The first saddle along a direction; -1 where it is no neighbour.
  int neighbour(int from, const Vec2& direction) const {
    const Saddle& a = saddles_[static_cast<std::size_t>(from)];
    int best = -1;
    double best_cost = 1e30;
    for (double radius = 2 * buckets_.pitch(); best < 0; radius *= 2) {
      // The box of the cone, from its apex to its base.
      const Vec2 base = a.px + radius * direction,
                 half(-kCone * radius * direction.y(), kCone * radius * direction.x());
      const Vec2 low = a.px.cwiseMin(base - half).cwiseMin(base + half);
      const Vec2 high = a.px.cwiseMax(base - half).cwiseMax(base + half);
      buckets_.between(low, high, [&](int i) {
        const Vec2 d = px(i) - a.px;
        const double along = d.dot(direction), beside = std::abs(cross(direction, d));
        if (!(along > 3) || along > radius || beside > kCone * along) return;
        const double cost = along + 2 * beside;
        if (cost < best_cost && is_alike(a, saddles_[static_cast<std::size_t>(i)]))
          best = i, best_cost = cost;
      });
      if (radius > buckets_.extent() / 2) break;
    }
    // Past a saddle that does not fit the next row but one would, and the whole lattice would be wrong.
    return best >= 0 && matches(a, saddles_[static_cast<std::size_t>(best)], true) ? best : -1;
  }

  int nearest(const Vec2& at, double radius, const Saddle& like, bool opposite) const {
    int best = -1;
    double best_distance = radius * radius;
    buckets_.within(at, radius, [&](int i) {
      const double distance = (px(i) - at).squaredNorm();
      if (distance < best_distance && taken_[static_cast<std::size_t>(i)] == 0 &&
          matches(like, saddles_[static_cast<std::size_t>(i)], opposite))
        best = i, best_distance = distance;
    });
    return best;
  }

  bool start(int seed) {
    queue_.clear();
    const Saddle& s = saddles_[static_cast<std::size_t>(seed)];
    // The neighbours along both edges, each in its two senses, looked for when they are asked for.
    constexpr int kUnknown = -2;
    int beside[4] = {kUnknown, kUnknown, kUnknown, kUnknown};
    const auto neighbour_of = [&](int edge, bool forward) {
      int& known = beside[2 * edge + (forward ? 1 : 0)];
      if (known == kUnknown) known = neighbour(seed, (forward ? 1 : -1) * s.edge[edge]);
      return known;
    };
    for (int k = 0; k < 4; ++k) {
      const bool first_forward = k < 2, second_forward = k % 2 == 0;
      const bool is_right_handed = (cross(s.edge[0], s.edge[1]) > 0) == (first_forward == second_forward);
      const int first = neighbour_of(0, first_forward);
      if (first < 0) continue;
      const int second = neighbour_of(1, second_forward);
      const int right = is_right_handed ? first : second, below = is_right_handed ? second : first;
      if (right < 0 || below < 0 || right == below) continue;
      const Vec2 step_x = px(right) - s.px, step_y = px(below) - s.px;
      const double least = std::min(step_x.norm(), step_y.norm());
      if (std::max(step_x.norm(), step_y.norm()) > 5 * least) continue;
      const int across = nearest(s.px + step_x + step_y, kNearness * least, s, false);
      if (across < 0 || across == seed) continue;
      put(0, 0, seed);
      put(1, 0, right);
      put(0, 1, below);
      put(1, 1, across);
      return true;
    }
    return false;
  }

  struct Foretold {
    Vec2 px;
    double nearness;
  };

  /// Where (i + di, j + dj) may be, the best guess first.
  std::vector<Foretold> foretell(int i, int j, int di, int dj) const {
    std::vector<Foretold> out;
    const auto here = place(i, j), before = place(i - di, j - dj);
    if (before) {
      const auto earlier = place(i - 2 * di, j - 2 * dj);
      const Vec2 step = *here - *before;
      // Perspective shortens the steps steadily.
      if (earlier)
        out.push_back({*here + step + 0.7 * (step - (*before - *earlier)), kNearnessOfThird});
      else
        out.push_back({*here + step, kNearness});
    }
    for (const int side : {1, -1}) {
      const auto beside = place(i + side * dj, j + side * di),
                 ahead = place(i + di + side * dj, j + dj + side * di);
      if (!beside || !ahead) continue;
      // Where the line itself said otherwise, only a whole block beside it is believed more.
      const auto beside_before = place(i - di + side * dj, j - dj + side * di);
      if (before && !beside_before) continue;
      // The step of the line beside this one, changed as the steps before it changed from line to line.
      const Vec2 change =
          before && beside_before ? Vec2((*here - *before) - (*beside - *beside_before)) : Vec2(0, 0);
      out.push_back({*here + (*ahead - *beside) + change, before ? kNearnessOfThird : kNearness});
    }
    return out;
  }

  bool is_outside(const Vec2& p) const {
    return p.x() < kBorderPx || p.y() < kBorderPx || p.x() > image_.width - 1 - kBorderPx ||
           p.y() > image_.height - 1 - kBorderPx;
  }

  /// Whether a node has a neighbour in that direction, or would have it outside of the image.
  bool is_held(const LatticeNode& n, int di, int dj) const {
    if (at_.get(n.i + di, n.j + dj) >= 0) return true;
    for (const auto& [ei, ej] : kDirections) {
      const auto beside = place(n.i + ei, n.j + ej), back = place(n.i + ei - di, n.j + ej - dj);
      if (beside && back) return is_outside(px(n.saddle) + (*beside - *back));
    }
    return false;
  }

  /// Whether the cell whose first corner is (i, j) is convex and right-handed, with opposite sides alike;
  /// nullopt where it is not whole.
  std::optional<bool> is_cell(int i, int j) const {
    const auto a = place(i, j), b = place(i + 1, j), c = place(i + 1, j + 1), d = place(i, j + 1);
    if (!a || !b || !c || !d) return std::nullopt;
    const Vec2 top = *b - *a, right = *c - *b, bottom = *d - *c, left = *a - *d;
    const auto alike = [](const Vec2& p, const Vec2& q) {
      return p.norm() < kMostRatio * q.norm() && q.norm() < kMostRatio * p.norm();
    };
    return cross(top, right) > 0 && cross(right, bottom) > 0 && cross(bottom, left) > 0 &&
           cross(left, top) > 0 && alike(top, bottom) && alike(left, right);
  }

  bool is_in_good_cells(const LatticeNode& n) const {
    int good = 0, bad = 0;
    for (const auto& [di, dj] : {std::pair{0, 0}, {-1, 0}, {0, -1}, {-1, -1}}) {
      const auto cell = is_cell(n.i + di, n.j + dj);
      if (cell) ++(*cell ? good : bad);
    }
    return bad == 0 || good > bad;
  }

  /// Without nodes that hang on one neighbour or fold the lattice: what grew out of the board into its
  /// surroundings.
  void prune() {
    std::size_t before = 0;
    while (before != nodes_.size()) {
      before = nodes_.size();
      std::erase_if(nodes_, [&](const LatticeNode& n) {
        int held = 0;
        for (const auto& [di, dj] : kDirections) held += is_held(n, di, dj) ? 1 : 0;
        if (held > 1 && is_in_good_cells(n)) return false;
        at_.set(n.i, n.j, -1);
        return true;
      });
    }
  }

  void extend(int i, int j, int di, int dj) {
    if (at_.get(i + di, j + dj) >= 0 || !Places::holds(i + di, j + dj)) return;
    const int from = at_.get(i, j);
    for (const Foretold& target : foretell(i, j, di, dj)) {
      const double radius = target.nearness * (target.px - px(from)).norm();
      const int found = nearest(target.px, radius, saddles_[static_cast<std::size_t>(from)], true);
      if (found < 0) continue;
      put(i + di, j + dj, found);
      return;
    }
  }

  const std::vector<Saddle>& saddles_;
  const Buckets& buckets_;
  cv::Size image_;
  std::vector<LatticeNode> nodes_;
  std::vector<LatticeNode> put_;  ///< all that were put, those pruned too
  Places at_;
  std::vector<char> taken_;
  std::deque<std::pair<int, int>> queue_;
};

bool is_large(const std::vector<LatticeNode>& nodes) {
  if (nodes.size() < 9) return false;
  const auto [i0, i1] =
      std::minmax_element(nodes.begin(), nodes.end(), [](auto& a, auto& b) { return a.i < b.i; });
  const auto [j0, j1] =
      std::minmax_element(nodes.begin(), nodes.end(), [](auto& a, auto& b) { return a.j < b.j; });
  return i1->i - i0->i >= 2 && j1->j - j0->j >= 2;
}

}  // namespace

void grow_lattices(const std::vector<Saddle>& saddles, cv::Size image,
                   const std::function<bool(const std::vector<LatticeNode>&)>& is_last) {
  if (saddles.size() < 9) return;
  const Buckets buckets(saddles);
  std::vector<char> seen(saddles.size(), 0);
  Growth growth(saddles, buckets, image);
  int n_grown = 0;
  for (std::size_t seed = 0; seed < saddles.size() && n_grown < kMostLattices; ++seed) {
    if (seen[seed] != 0) continue;
    const auto nodes = growth.from(static_cast<int>(seed));
    if (!is_large(nodes)) continue;
    for (const LatticeNode& n : nodes) seen[static_cast<std::size_t>(n.saddle)] = 1;
    ++n_grown;
    if (is_last(nodes)) return;
  }
}

}  // namespace plumbline::detail
