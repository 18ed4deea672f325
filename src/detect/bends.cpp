// SPDX-License-Identifier: Apache-2.0
#include "detect/bends.hpp"

#include <algorithm>
#include <cmath>

namespace plumbline::detail {
namespace {

constexpr double kMaxBendPx = 0.01;  ///< of an edge within its window, before it is taken into account
constexpr double kNear = 0.5;        ///< [board units] nearer corners say little of a bend
constexpr double kFar = 2.5;         ///< those farther away say little of this place

/// Curvature [1/px] of the board line through `corner` along an axis, by the two nearest other corners on it.
double curvature(const std::vector<Refined>& corners, const Refined& corner, int axis) {
  std::vector<const Refined*> line;
  for (const Refined& r : corners) {
    const Vec2 d = r.board - corner.board;
    if (std::abs(d[1 - axis]) < 1e-6 && std::abs(d[axis]) > kNear && std::abs(d[axis]) < kFar)
      line.push_back(&r);
  }
  std::sort(line.begin(), line.end(), [&](const Refined* a, const Refined* b) {
    return std::abs(a->board[axis] - corner.board[axis]) < std::abs(b->board[axis] - corner.board[axis]);
  });
  for (std::size_t i = 1; i < line.size(); ++i) {
    const double s = line[0]->board[axis] - corner.board[axis], t = line[i]->board[axis] - corner.board[axis];
    if (std::abs(s - t) < kNear) continue;
    // The quadratic through the three places: p + a x + b x^2.
    const Vec2 u = (line[0]->px - corner.px) / s, v = (line[i]->px - corner.px) / t;
    const Vec2 b = (u - v) / (s - t), a = u - b * s;
    return 2 * (a.x() * b.y() - a.y() * b.x()) / (a.norm() * a.squaredNorm());
  }
  return 0;
}

}  // namespace

void refit_bent(const cv::Mat& grey, double noise, const std::map<int, SaddleWindow>& windows,
                std::vector<Refined>& corners) {
  const std::vector<Refined> before = corners;
  for (Refined& corner : corners) {
    const auto found = windows.find(corner.point);
    if (found == windows.end()) continue;
    SaddleWindow window = found->second;
    for (int axis = 0; axis < 2; ++axis) {
      const double arm = std::min(window.max_arm_px, 0.5 * window.J.col(axis).norm());
      const double bend = curvature(before, corner, axis);
      if (std::abs(bend) * arm * arm / 2 > kMaxBendPx) window.curvature[axis] = bend;
    }
    if (window.curvature.isZero(0)) continue;
    if (const auto fit = fit_saddle(grey, corner.px, window, noise))
      corner.px = fit->px, corner.sigma = fit->sigma_px;
  }
}

}  // namespace plumbline::detail
