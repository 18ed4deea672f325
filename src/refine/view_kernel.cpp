// SPDX-License-Identifier: Apache-2.0
#include "refine/view_kernel.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "refine/view_kernel_sets.hpp"

namespace plumbline::detail {

const KernelSet& best_kernels() {
#ifdef PLUMBLINE_X86_KERNELS
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")) return kAvx512Kernels;
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return kAvx2Kernels;
#endif
  return kBaselineKernels;
}

const char* kernel_name() { return best_kernels().name; }

namespace {

// A lens' domain is a cone about its axis, so the corner farthest from the axis speaks for all.
bool in_domain(const Lens& lens, const KernelAnswer& answer) {
  const double square = answer.far_z / answer.far_nn;
  const double cosine = std::copysign(std::sqrt(std::abs(square)), square);
  return project(lens, Vec3(std::sqrt(std::max(0.0, 1 - cosine * cosine)), 0, cosine)).has_value();
}

}  // namespace

ViewCorners view_corners(const std::vector<Observation>& observations, const ViewCorners* like) {
  ViewCorners corners;
  corners.n = static_cast<int>(observations.size());
  const auto n = static_cast<std::size_t>(corners.n_padded());
  std::vector<double> points(4 * n);
  corners.px.resize(2 * n);
  for (std::size_t i = 0; i < n; ++i) {
    const Observation& o = observations[std::min(i, observations.size() - 1)];
    for (std::size_t c = 0; c < 3; ++c) points[c * n + i] = o.p_board[static_cast<Eigen::Index>(c)];
    points[3 * n + i] = i < observations.size() ? o.weight : 0.0;
    corners.px[i] = o.px.x();
    corners.px[n + i] = o.px.y();
  }
  if (like && like->n == corners.n && *like->points == points)
    corners.points = like->points;
  else
    corners.points = std::make_shared<const std::vector<double>>(std::move(points));
  return corners;
}

namespace {

using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

// A state as the kernel reads it.
struct Numbers {
  RowMajor3 R;
  Vec3 t;
  explicit Numbers(const SE3& T) : R(T.R()), t(T.t()) {}
  KernelState with(const Lens& lens) const { return {params(lens).data(), R.data(), t.data()}; }
};

KernelInput input_of(const ViewQuestion& q, const KernelState& at, const KernelState& second) {
  return {at,
          second,
          q.corners.points->data(),
          q.corners.px.data(),
          q.corners.n_padded(),
          static_cast<int>(q.loss),
          q.loss_scale};
}

bool usable(const Lens& lens, const KernelAnswer& answer) {
  return std::isfinite(answer.cost) && in_domain(lens, answer);
}

}  // namespace

std::optional<double> accumulate_view(const ViewQuestion& question, Gram* gram) {
  std::vector<double> s;
  if (question.loss == Loss::kCauchy) s.resize(static_cast<std::size_t>(question.corners.n_padded()));
  const Numbers at(question.T_cam_board);
  const KernelInput in = input_of(question, at.with(question.lens), {});
  const KernelAnswer answer = best_kernels().functions[question.lens.index()](
      in, gram ? gram->lower : nullptr, s.empty() ? nullptr : s.data(), nullptr);
  double cost = answer.cost;
  for (int i = 0; i < question.corners.n && !s.empty(); ++i)
    cost += 0.5 * rho(question.loss, question.loss_scale, s[static_cast<std::size_t>(i)]).value;
  if (!usable(question.lens, answer) || !std::isfinite(cost)) return std::nullopt;
  return cost;
}

std::optional<VecX> accumulate_second(const ViewQuestion& question, const Lens& other_lens,
                                      const SE3& other_T_cam_board) {
  if (!accumulate_view({other_lens, other_T_cam_board, question.corners}, nullptr)) return std::nullopt;
  const Numbers at(question.T_cam_board), second(other_T_cam_board);
  const KernelInput in = input_of(question, at.with(question.lens), second.with(other_lens));
  Gram gram;
  VecX products(n_params(question.lens) + 6);
  const KernelAnswer answer =
      best_kernels().functions[question.lens.index()](in, gram.lower, nullptr, products.data());
  if (!usable(question.lens, answer)) return std::nullopt;
  return products;
}

}  // namespace plumbline::detail
