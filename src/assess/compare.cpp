// SPDX-License-Identifier: Apache-2.0
#include "plumbline/assess/compare.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plumbline/core/linalg.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/rig/validity.hpp"

namespace plumbline {
namespace {

constexpr int kColumns = 60, kRows = 45;

struct Sample {
  Vec2 px_a;
  Vec3 p_a;  // in a's frame, at the distance of comparison
};

std::vector<Sample> samples_of(const Camera& a, double distance_m,
                               const std::function<bool(const Vec2&)>& wanted) {
  std::vector<Sample> samples;
  for (int row = 0; row < kRows; ++row) {
    for (int col = 0; col < kColumns; ++col) {
      const Vec2 px(col * (a.size.width - 1.0) / (kColumns - 1), row * (a.size.height - 1.0) / (kRows - 1));
      if (wanted && !wanted(px)) continue;
      if (const auto ray = unproject(a, px)) samples.push_back({px, distance_m * *ray});
    }
  }
  return samples;
}

// The normal equations of sum |b(T p) - px|^2 over the step [dw | dt] of box_plus, and the sum.
struct Normal {
  Mat6 A = Mat6::Zero();
  Vec6 g = Vec6::Zero();
  double cost = 0;
  int n = 0;
};

Normal linearise(const std::vector<Sample>& samples, const Projection& b, const SE3& T_b_a) {
  Normal out;
  const Mat3 R = T_b_a.R();
  for (const Sample& s : samples) {
    const Vec3 turned = R * s.p_a;
    Mat23 J_px_p;
    const auto px = b(turned + T_b_a.t(), &J_px_p);
    if (!px) continue;
    Mat26 J;
    J << -J_px_p * skew(turned), J_px_p;
    const Vec2 e = *px - s.px_a;
    out.A += J.transpose() * J;
    out.g += J.transpose() * e;
    out.cost += e.squaredNorm();
    ++out.n;
  }
  return out;
}

// Levenberg-Marquardt over the first 3 (rotation) or all 6 numbers. A step that loses samples to the end of
// the domain is refused: it would look better than it is.
SE3 best_alignment(const std::vector<Sample>& samples, const Projection& b, int n_free) {
  SE3 T;
  Normal now = linearise(samples, b, T);
  double damping = 1e-6;
  for (int i = 0; i < 60 && now.n > 0 && damping < 1e9; ++i) {
    MatX A = now.A.topLeftCorner(n_free, n_free);
    A.diagonal() *= 1 + damping;
    const auto step = solve_spd(A, -now.g.head(n_free));
    if (!step) break;
    Vec6 d = Vec6::Zero();
    d.head(n_free) = *step;
    const SE3 trial = box_plus(T, d);
    const Normal next = linearise(samples, b, trial);
    if (next.n < now.n || !(next.cost < now.cost)) {
      damping *= 10;
      continue;
    }
    const bool done = next.cost > now.cost * (1 - 1e-14) || d.norm() < 1e-15;
    T = trial;
    now = next;
    damping = std::max(damping * 0.1, 1e-12);
    if (done) break;
  }
  return T;
}

}  // namespace

Result<DiffPx> compare_cameras(const Camera& a, const Camera& b, Align align, double distance_m) {
  if (a.size != b.size) {
    return Error{ErrorCode::kInvalidData,
                 fmt::format("images of {}x{} and {}x{} pixels cannot be compared", a.size.width,
                             a.size.height, b.size.width, b.size.height),
                 a.name == b.name ? "camera " + a.name : "cameras " + a.name + " and " + b.name};
  }
  return compare_projection(
      a, [&b](const Vec3& p, Mat23* J) { return project(b, p, J); }, align, distance_m);
}

Result<DiffPx> compare_projection(const Camera& a, const Projection& b, Align align, double distance_m,
                                  const std::function<bool(const Vec2&)>& wanted) {
  PLUMBLINE_CHECK(distance_m > 0 && std::isfinite(distance_m), "the distance of comparison is positive");
  const std::vector<Sample> samples = samples_of(a, distance_m, wanted);
  SE3 T_b_a;
  if (align != Align::kNone) T_b_a = best_alignment(samples, b, align == Align::kRotation ? 3 : 6);
  std::vector<double> distances;
  double sum = 0;
  for (const Sample& s : samples) {
    const auto px = b(T_b_a * s.p_a, nullptr);
    if (!px) continue;
    distances.push_back((*px - s.px_a).norm());
    sum += distances.back() * distances.back();
  }
  const int n = static_cast<int>(distances.size());
  if (n < 10) {
    return Error{ErrorCode::kDegenerate,
                 fmt::format("only {} of {} grid points are seen by both lenses, at least 10 are needed", n,
                             kColumns * kRows),
                 "camera " + a.name};
  }
  std::sort(distances.begin(), distances.end());
  DiffPx out;
  out.rms = std::sqrt(sum / n);
  out.p95 = distances[static_cast<std::size_t>(std::ceil(0.95 * n)) - 1];
  out.max = distances.back();
  out.n_samples = n;
  out.compared_fraction = static_cast<double>(n) / (kColumns * kRows);
  return out;
}

}  // namespace plumbline
