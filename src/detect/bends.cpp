// SPDX-License-Identifier: Apache-2.0
#include "detect/bends.hpp"

#include <algorithm>
#include <cmath>

namespace plumbline::detail {
namespace {

constexpr double kMaxBendPx = 0.01;  ///< of an edge within its window, before it is taken into account
constexpr double kLongArmPx = 40;    ///< of windows in much noise
constexpr double kMostBendPx = 0.3;  ///< a parabola is a bent edge so far
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

void set_bends(const Vec2& bend, SaddleWindow& window) {
  const double most = std::max(1e-9, bend.cwiseAbs().maxCoeff());
  window.long_arm_px = std::min(kLongArmPx, std::sqrt(2 * kMostBendPx / most));
  for (int axis = 0; axis < 2; ++axis) {
    const double longest = std::max(window.max_arm_px, window.long_arm_px);
    const double arm = std::min(longest, 0.5 * window.J.col(axis).norm());
    if (std::abs(bend[axis]) * arm * arm / 2 > kMaxBendPx) window.curvature[axis] = bend[axis];
  }
}

void refit_bent(const cv::Mat& grey, double noise, const std::map<int, SaddleWindow>& windows,
                std::vector<Refined>& corners) {
  const std::vector<Refined> before = corners;
  for (Refined& corner : corners) {
    const auto found = windows.find(corner.point);
    if (found == windows.end()) continue;
    SaddleWindow window = found->second;
    const Vec2 bend(curvature(before, corner, 0), curvature(before, corner, 1));
    set_bends(bend, window);
    if (window.curvature.isZero(0) && corner.sigma < kRoughSigmaPx) continue;
    if (const auto fit = fit_saddle(grey, corner.px, window, noise))
      corner.px = fit->px, corner.sigma = fit->sigma_px;
  }
}

}  // namespace plumbline::detail
