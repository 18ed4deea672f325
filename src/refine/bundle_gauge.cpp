// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "plumbline/core/linalg.hpp"
#include "plumbline/geometry/so3.hpp"
#include "refine/bundle_setup.hpp"

namespace plumbline::detail {
namespace {

constexpr int kSimilarity = 7;  // rotation, position, scale
// Squared ratio below which a degree of freedom counts as free: three held points whose width over length is
// under 1e-6 are on a line.
constexpr double kFree = 1e-12;

using Rows3 = Eigen::Matrix<double, 3, kSimilarity>;
using Row = Eigen::Matrix<double, 1, kSimilarity>;
using Normal = Eigen::Matrix<double, kSimilarity, kSimilarity>;

// Free views and points that hang together, with the held ones that they touch. Held ones connect nothing:
// what two parts know of each other through them alone is less than a common gauge.
struct Part {
  std::vector<int> views, points;            // free
  std::vector<int> held_views, held_points;  // may be there several times
};

class Union {
 public:
  explicit Union(std::size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), 0); }
  int root(int i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(int a, int b) { parent_[std::max(root(a), root(b))] = std::min(root(a), root(b)); }

 private:
  std::vector<int> parent_;
};

std::vector<Part> parts_of(const Reconstruction& scene, const BundleSetup& setup, const Participation& part) {
  const int n_views = static_cast<int>(scene.views.size()), n_points = static_cast<int>(scene.p_world.size());
  Union groups(n_views + n_points);
  const auto each_sighting = [&](auto&& body) {
    for (std::size_t i = 0; i < scene.sightings.size(); ++i)
      if (part.sighting[i]) body(scene.sightings[i].view, scene.sightings[i].point);
  };
  each_sighting([&](int v, int p) {
    if (!setup.view_held[v] && !setup.point_held[p]) groups.join(v, n_views + p);
  });
  for (const ScaleBar& bar : setup.bars) {
    if (!setup.point_held[bar.point_a] && !setup.point_held[bar.point_b])
      groups.join(n_views + bar.point_a, n_views + bar.point_b);
  }
  std::map<int, Part> found;
  for (int v = 0; v < n_views; ++v)
    if (part.view[v] && !setup.view_held[v]) found[groups.root(v)].views.push_back(v);
  for (int p = 0; p < n_points; ++p)
    if (part.point[p] && !setup.point_held[p]) found[groups.root(n_views + p)].points.push_back(p);
  each_sighting([&](int v, int p) {
    if (setup.view_held[v] && !setup.point_held[p]) found[groups.root(n_views + p)].held_views.push_back(v);
    if (!setup.view_held[v] && setup.point_held[p]) found[groups.root(v)].held_points.push_back(p);
  });
  std::vector<Part> parts;
  for (auto& [root, one] : found) {
    for (std::vector<int>* list : {&one.held_views, &one.held_points}) {
      std::sort(list->begin(), list->end());
      list->erase(std::unique(list->begin(), list->end()), list->end());
    }
    parts.push_back(std::move(one));
  }
  return parts;
}

// How positions move under the similarities about `centre`, in units of `size`.
struct Similarities {
  Vec3 centre = Vec3::Zero();
  double size = 1;

  Rows3 move(const Vec3& p) const {
    const Vec3 q = (p - centre) / size;
    Rows3 rows;
    rows << -skew(q), Mat3::Identity(), q;
    return rows;
  }
};

Similarities similarities_of(const Reconstruction& scene, const Part& part) {
  std::vector<Vec3> positions;
  for (const auto* list : {&part.points, &part.held_points})
    for (int p : *list) positions.push_back(scene.p_world[p]);
  for (const auto* list : {&part.views, &part.held_views})
    for (int v : *list) positions.push_back(scene.views[v].T_cam_world.centre());
  Similarities s;
  for (const Vec3& p : positions) s.centre += p / static_cast<double>(positions.size());
  double sum = 0;
  for (const Vec3& p : positions) sum += (p - s.centre).squaredNorm();
  if (sum > 0) s.size = std::sqrt(sum / static_cast<double>(positions.size()));
  return s;
}

// Degrees of freedom of the similarities that nothing holds.
int count_free(const Reconstruction& scene, const BundleSetup& setup, const Part& part) {
  const Similarities similarities = similarities_of(scene, part);
  Normal N = Normal::Zero();
  const auto hold = [&N](const auto& rows) { N += rows.transpose() * rows; };
  const auto is_in = [](const std::vector<int>& list, int i) {
    return std::binary_search(list.begin(), list.end(), i);
  };
  for (int v : part.held_views) {
    Rows3 turn = Rows3::Zero();
    turn.leftCols<3>().setIdentity();
    hold(turn);
    hold(similarities.move(scene.views[v].T_cam_world.centre()));
  }
  for (int p : part.held_points) hold(similarities.move(scene.p_world[p]));
  // Fixed distances: how the one end moves against the other, along the line between them.
  const auto hold_distance = [&](const Vec3& a, const Vec3& b, bool a_moves, bool b_moves) {
    const double length = (a - b).norm();
    if (!(length > 0)) return;
    const Vec3 u = (a - b) / length;
    Row row = Row::Zero();
    if (a_moves) row += u.transpose() * similarities.move(a);
    if (b_moves) row -= u.transpose() * similarities.move(b);
    hold(Row(row * (similarities.size / length)));
  };
  if (setup.sphere && is_in(part.views, setup.sphere_view))
    hold_distance(scene.views[setup.sphere_view].T_cam_world.centre(), setup.sphere->anchor(), true, false);
  for (const ScaleBar& bar : setup.bars) {
    const bool a = is_in(part.points, bar.point_a), b = is_in(part.points, bar.point_b);
    if (a || b) hold_distance(scene.p_world[bar.point_a], scene.p_world[bar.point_b], a, b);
  }
  const VecX values = sym_eigen(N).values;
  const double least = kFree * std::max(values[kSimilarity - 1], 1.0);
  return static_cast<int>(
      std::count_if(values.begin(), values.end(), [&](double v) { return !(v > least); }));
}

// Brings the scene to the size that the bars say (least squares), about a point that stays: the solver would
// have to walk there in many steps.
void scale_to_bars(Reconstruction& scene, const std::vector<ScaleBar>& bars, const Vec3& fixed) {
  double top = 0, bottom = 0;
  for (const ScaleBar& bar : bars) {
    const double length = (scene.p_world[bar.point_a] - scene.p_world[bar.point_b]).norm();
    const double weight = 1 / (bar.sigma_m * bar.sigma_m);
    top += weight * bar.length_m * length;
    bottom += weight * length * length;
  }
  if (!(top > 0 && bottom > 0) || !std::isfinite(top / bottom)) return;
  const double scale = top / bottom;
  for (Vec3& p : scene.p_world) p = fixed + scale * (p - fixed);
  for (ReconstructionView& view : scene.views) {
    const Vec3 centre = view.T_cam_world.centre();
    const Vec3 t = -(view.T_cam_world.R() * (fixed + scale * (centre - fixed)));
    std::copy_n(t.data(), 3, view.T_cam_world.qt.begin() + 4);
  }
}

std::string plural(std::size_t n, const std::string& noun) {
  return fmt::format("{} {}{}", n, noun, n == 1 ? "" : "s");
}

// Nothing is held: the first view, and the bars or the distance to the view farthest from it.
Status hold_default(BundleSetup& setup, Reconstruction& scene, const Participation& part) {
  const auto first_used = std::find(part.view.begin(), part.view.end(), true);
  const int first = static_cast<int>(first_used - part.view.begin());
  setup.view_held[first] = true;
  setup.gauge = view_name(scene, first) + " is held, and ";
  const Vec3 centre = scene.views[first].T_cam_world.centre();
  if (!setup.bars.empty()) {
    const SE3 held = scene.views[first].T_cam_world;
    scale_to_bars(scene, setup.bars, centre);
    scene.views[first].T_cam_world = held;  // to the last bit
    setup.gauge +=
        plural(setup.bars.size(), "scale bar") + (setup.bars.size() == 1 ? " gives" : " give") + " the scale";
    return {};
  }
  int farthest = -1;
  double distance = 0;
  for (std::size_t v = 0; v < scene.views.size(); ++v) {
    if (!part.view[v]) continue;
    const double d = (scene.views[v].T_cam_world.centre() - centre).norm();
    if (d > distance) distance = d, farthest = static_cast<int>(v);
  }
  if (farthest < 0) {
    return Error{ErrorCode::kDegenerate,
                 "all views stand in one place, so that no distance can be held and no point be placed; add "
                 "views from elsewhere",
                 "gauge"};
  }
  setup.sphere_view = farthest;
  setup.sphere.emplace(centre, distance);
  setup.gauge += "the distance of " + view_name(scene, farthest) + " from it";
  return {};
}

}  // namespace

Status check_gauge(const BundleSetup& setup, const Reconstruction& scene, const Participation& part) {
  for (const ScaleBar& bar : setup.bars) {
    for (int p : {bar.point_a, bar.point_b}) {
      if (part.point[p] || setup.point_held[p]) continue;
      return Error{ErrorCode::kDegenerate,
                   point_name(scene, p) +
                       " is left out (too few views, or parallel rays); measure a bar between "
                       "points that are seen well",
                   fmt::format("scale bar {},{}", bar.point_a, bar.point_b)};
    }
  }
  const std::vector<Part> parts = parts_of(scene, setup, part);
  for (const Part& one : parts) {
    const int n_free = count_free(scene, setup, one);
    if (n_free == 0) continue;
    const std::string which =
        one.views.empty() ? point_name(scene, one.points[0]) : view_name(scene, one.views[0]);
    if (parts.size() > 1) {
      return Error{
          ErrorCode::kDegenerate,
          fmt::format("the scene falls into {} groups without common free points; the one of {} ({} "
                      "views, {} points) is free in {} of 7 degrees of freedom; leave it out, or hold "
                      "something in it",
                      parts.size(), which, one.views.size(), one.points.size(), n_free),
          "gauge"};
    }
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("the scene is free in {} of 7 degrees of freedom (rotation 3, position 3, scale 1) "
                    "although {}; hold a view, or three points that are not on a line, and give the "
                    "scale by a second held view or a scale bar; or hold nothing, for the default",
                    n_free, setup.gauge),
        "gauge"};
  }
  return {};
}

Status fix_gauge(BundleSetup& setup, Reconstruction& scene, const Participation& part,
                 const BundleOptions& options) {
  const bool default_gauge = options.hold_views.empty() && options.hold_points.empty();
  if (default_gauge) {
    if (Status held = hold_default(setup, scene, part); !held) return held;
  } else {
    setup.gauge =
        fmt::format("{}, {} and {} are held", plural(options.hold_views.size(), "view"),
                    plural(options.hold_points.size(), "point"), plural(setup.bars.size(), "scale bar"));
  }
  return check_gauge(setup, scene, part);
}

}  // namespace plumbline::detail
