// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "outliers/outliers.hpp"
#include "plumbline/assess/compare.hpp"
#include "plumbline/core/random.hpp"
#include "plumbline/synth/scene.hpp"

namespace plumbline::bench {
namespace {

constexpr int kColumns = 11, kRows = 8;
constexpr double kShare = 0.05;

struct Place {
  std::size_t view, corner;
};

// That many different corners.
std::vector<Place> draw(const Dataset& data, std::size_t n, Rng& rng) {
  std::vector<Place> all;
  for (std::size_t v = 0; v < data.views.size(); ++v) {
    for (std::size_t i = 0; i < data.views[v].corners.size(); ++i) all.push_back({v, i});
  }
  for (std::size_t i = 0; i < n; ++i)
    std::swap(all[i], all[i + static_cast<std::size_t>(rng.index(static_cast<int>(all.size() - i)))]);
  all.resize(n);
  return all;
}

void swap_neighbours(Dataset& data, std::size_t n_corners, Rng& rng) {
  std::set<std::pair<std::size_t, int>> used;
  for (std::size_t n = 0; n < n_corners;) {
    const Place place = draw(data, 1, rng).front();
    auto& corners = data.views[place.view].corners;
    const int column = corners[place.corner].point % kColumns;
    const std::size_t other = column + 1 < kColumns ? place.corner + 1 : place.corner - 1;
    const int a = static_cast<int>(place.corner), b = static_cast<int>(other);
    if (used.contains({place.view, a}) || used.contains({place.view, b})) continue;
    used.insert({place.view, a});
    used.insert({place.view, b});
    std::swap(corners[place.corner].px, corners[other].px);
    n += 2;
  }
}

void shift_rows(View& view) {
  const std::vector<Corner> before = view.corners;
  for (std::size_t i = 0; i < before.size(); ++i)
    view.corners[(i + kColumns) % before.size()].px = before[i].px;
}

}  // namespace

const char* name_of(Fault fault) {
  constexpr const char* kNames[] = {"none", "uniform", "5 to 20 px", "swapped", "shifted rows"};
  return kNames[static_cast<int>(fault)];
}

Calibration make_truth(const Kind& kind, std::uint64_t seed) {
  const Target target = *make_target(Chessboard{.columns = kColumns, .rows = kRows, .square_m = 0.03});
  SceneOptions options;
  options.lens = kind.lens;
  options.fov_deg = kind.fov_deg;
  options.size = {1280, 960};
  options.noise_px = 0.2;
  options.seed = seed;
  return *simulate(target, options);
}

Dataset with_fault(const Dataset& clean, Fault fault, std::uint64_t seed) {
  Dataset data = clean;
  Rng rng(seed + 1000);
  std::size_t n = 0;
  for (const View& view : data.views) n += view.corners.size();
  const auto n_wrong = static_cast<std::size_t>(kShare * static_cast<double>(n) + 0.5);
  if (fault == Fault::kUniform || fault == Fault::kNear) {
    for (const Place& place : draw(data, n_wrong, rng)) {
      View& view = data.views[place.view];
      Vec2& px = view.corners[place.corner].px;
      const ImageSize size = data.cameras[view.cam].size;
      const double off = rng.uniform(5, 20), around = rng.uniform(0, 2 * std::numbers::pi);
      if (fault == Fault::kUniform)
        px = Vec2(rng.uniform(0, size.width - 1), rng.uniform(0, size.height - 1));
      else
        px += off * Vec2(std::cos(around), std::sin(around));
    }
  } else if (fault == Fault::kSwapped) {
    swap_neighbours(data, n_wrong, rng);
  } else if (fault == Fault::kShifted) {
    shift_rows(data.views[static_cast<std::size_t>(rng.index(static_cast<int>(data.views.size())))]);
  }
  return data;
}

std::optional<ErrorPx> error_px(const Calibration& truth, const Camera& estimate) {
  const Camera& camera = truth.rig.cameras[0];
  const double reach = 0.05 * std::hypot(camera.size.width, camera.size.height);
  const auto is_near = [&](const Vec2& px) {
    for (const View& view : truth.data.views) {
      for (const Corner& c : view.corners) {
        if ((c.px - px).squaredNorm() < reach * reach) return true;
      }
    }
    return false;
  };
  const Projection estimated = [&](const Vec3& p_cam, Mat23* J) { return project(estimate.lens, p_cam, J); };
  const auto near = compare_projection(camera, estimated, Align::kRotation, 1.0, is_near);
  const auto whole = compare_projection(camera, estimated, Align::kRotation);
  if (!near || !whole) return std::nullopt;
  return ErrorPx{near->rms, whole->rms};
}

}  // namespace plumbline::bench
