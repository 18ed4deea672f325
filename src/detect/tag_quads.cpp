// SPDX-License-Identifier: Apache-2.0
#include "detect/tag_quads.hpp"

#include <algorithm>
#include <cmath>

#include "detect/buckets.hpp"
#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

/// Off an edge's direction that the next saddle may lie, and cosine between a side and the edge that it ends
/// in: a saddle's second differences say its edges to some 20 degrees where these do not cross at right
/// angles.
constexpr double kCone = 0.5, kSameTurn = 0.75;
constexpr std::size_t kMostTried = 12;  ///< saddles along an edge
/// How far from a side [its length] is looked for dark and bright: half of the border of one module of the
/// narrowest kind.
constexpr double kBeside = 0.055, kLeastBesidePx = 1.2;
constexpr double kLeastStep = 6;      ///< [grey levels] across a side
constexpr double kWeakStep = 0.25;    ///< of the largest along the side
constexpr double kParallel = 0.4;     ///< off the parallelogram [its shorter side] where one side is not seen
constexpr double kMostStretched = 6;  ///< longest side over shortest

double cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

/// One of the two dark fields at a saddle. Clockwise around the field one comes along -in and goes on along
/// out.
struct Field {
  Vec2 in, out;
  int next = -1;  ///< field at the next corner
};

void add_fields(const Saddle& s, std::vector<Field>& fields) {
  const Vec2 dark(-s.bright.y(), s.bright.x());
  for (const double side : {1.0, -1.0}) {
    const Vec2 a = s.edge[0] * (s.edge[0].dot(dark) * side > 0 ? 1 : -1);
    const Vec2 b = s.edge[1] * (s.edge[1].dot(dark) * side > 0 ? 1 : -1);
    fields.push_back(cross(a, b) > 0 ? Field{b, a} : Field{a, b});
  }
}

/// Dark to the right of the way from a to b and bright to its left.
bool is_side(const cv::Mat& grey, const Vec2& a, const Vec2& b) {
  const Vec2 along = b - a;
  const double length = along.norm();
  const double beside = std::max(kLeastBesidePx, kBeside * length);
  const Vec2 right = Vec2(-along.y(), along.x()) * (beside / length);
  double least = 1e9, most = 0;
  for (const double t : {0.18, 0.34, 0.5, 0.66, 0.82}) {
    const Vec2 p = a + t * along;
    const double step = sample(grey, p - right) - sample(grey, p + right);
    least = std::min(least, step);
    most = std::max(most, step);
    if (least < kLeastStep) return false;
  }
  return least > kWeakStep * most;
}

class Sides {
 public:
  Sides(const cv::Mat& grey, const std::vector<Saddle>& saddles, double most_px)
      : grey_(grey), saddles_(saddles), buckets_(saddles), most_px_(most_px) {
    fields_.reserve(2 * saddles.size());
    for (const Saddle& s : saddles) add_fields(s, fields_);
    for (std::size_t f = 0; f < fields_.size(); ++f) fields_[f].next = next(static_cast<int>(f));
  }

  std::vector<DarkQuad> quads() const {
    std::vector<DarkQuad> out;
    for (int a = 0; a < static_cast<int>(fields_.size()); ++a) {
      const int b = after(a), c = after(b), d = after(c);
      if (d < 0 || a == c || b == d || a == d) continue;
      const int back = after(d);
      // Each whole turn is met four times, one with a gap once.
      if (back == a ? a != std::min({a, b, c, d}) : back >= 0) continue;
      const DarkQuad quad{a / 2, b / 2, c / 2, d / 2};
      if (is_plausible(quad, back == a)) out.push_back(quad);
    }
    return out;
  }

 private:
  struct Candidate {
    double along;
    int saddle;
  };

  const Vec2& px(int saddle) const { return saddles_[static_cast<std::size_t>(saddle)].px; }
  int after(int field) const { return field < 0 ? -1 : fields_[static_cast<std::size_t>(field)].next; }

  /// The field at saddle j that a side from p ends in; -1 where none does.
  int ending(const Vec2& p, int j) const {
    const Vec2 back = (p - px(j)).normalized();
    int best = -1;
    double most = kSameTurn;
    for (const int g : {2 * j, 2 * j + 1}) {
      const double turn = fields_[static_cast<std::size_t>(g)].in.dot(back);
      if (turn > most) most = turn, best = g;
    }
    return best;
  }

  /// The field at the other end of the side that begins at a field; -1 where none is seen.
  int next(int field) const {
    const Vec2& p = px(field / 2);
    const Vec2 out = fields_[static_cast<std::size_t>(field)].out, beside = kCone * Vec2(-out.y(), out.x());
    std::vector<Candidate> near;
    std::size_t n_tried = 0;
    for (double from = 2, to = 2 * buckets_.pitch(); from < most_px_; from = to, to *= 2) {
      to = std::min(to, most_px_);
      near.clear();
      // The piece of the cone between the two distances.
      const Vec2 near_left = p + from * (out - beside), near_right = p + from * (out + beside);
      const Vec2 far_left = p + to * (out - beside), far_right = p + to * (out + beside);
      buckets_.between(near_left.cwiseMin(near_right).cwiseMin(far_left).cwiseMin(far_right),
                       near_left.cwiseMax(near_right).cwiseMax(far_left).cwiseMax(far_right), [&](int i) {
                         const Vec2 d = px(i) - p;
                         const double along = d.dot(out);
                         if (along > from && along <= to && std::abs(cross(out, d)) <= kCone * along)
                           near.push_back({along, i});
                       });
      std::sort(near.begin(), near.end(), [](const Candidate& a, const Candidate& b) {
        return a.along != b.along ? a.along < b.along : a.saddle < b.saddle;
      });
      for (const Candidate& c : near) {
        if (++n_tried > kMostTried) return -1;
        const int g = ending(p, c.saddle);
        if (g >= 0 && is_side(grey_, p, px(c.saddle))) return g;
      }
    }
    return -1;
  }

  bool is_plausible(const DarkQuad& quad, bool is_whole) const {
    double shortest = 1e9, longest = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const Vec2 side = px(quad[(k + 1) % 4]) - px(quad[k]);
      const Vec2 then = px(quad[(k + 2) % 4]) - px(quad[(k + 1) % 4]);
      if (!(cross(side, then) > 0)) return false;
      shortest = std::min(shortest, side.norm());
      longest = std::max(longest, side.norm());
    }
    if (longest > kMostStretched * shortest) return false;
    const Vec2 off = px(quad[0]) - px(quad[1]) + px(quad[2]) - px(quad[3]);
    return is_whole || off.norm() < kParallel * shortest;
  }

  const cv::Mat& grey_;
  const std::vector<Saddle>& saddles_;
  Buckets buckets_;
  double most_px_;
  std::vector<Field> fields_;
};

}  // namespace

std::vector<DarkQuad> find_dark_quads(const cv::Mat& grey, const std::vector<Saddle>& saddles,
                                      double most_px) {
  if (saddles.size() < 4) return {};
  return Sides(grey, saddles, most_px).quads();
}

}  // namespace plumbline::detail
