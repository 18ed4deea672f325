// SPDX-License-Identifier: Apache-2.0
#include "refine/view_kernel.hpp"

#include <algorithm>
#include <cmath>

#include "refine/view_kernel_sets.hpp"

namespace plumbline::detail {
namespace {

const KernelSet& best_kernels() {
#ifdef PLUMBLINE_X86_KERNELS
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")) return kAvx512Kernels;
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return kAvx2Kernels;
#endif
  return kBaselineKernels;
}

// A lens' domain is a cone about its axis, so the corner farthest from the axis speaks for all.
bool in_domain(const Lens& lens, double farthest) {
  const double cosine = std::copysign(std::sqrt(std::abs(farthest)), farthest);
  return project(lens, Vec3(std::sqrt(std::max(0.0, 1 - cosine * cosine)), 0, cosine)).has_value();
}

}  // namespace

const char* kernel_name() { return best_kernels().name; }

ViewCorners view_corners(const std::vector<Observation>& observations) {
  ViewCorners corners;
  corners.n = static_cast<int>(observations.size());
  const int n = corners.n_padded();
  corners.columns.resize(static_cast<std::size_t>(6 * n));
  for (int i = 0; i < n; ++i) {
    const Observation& o = observations[static_cast<std::size_t>(std::min(i, corners.n - 1))];
    const double values[] = {o.p_board.x(), o.p_board.y(), o.p_board.z(),
                             o.px.x(),      o.px.y(),      i < corners.n ? o.weight : 0.0};
    for (int c = 0; c < 6; ++c) corners.columns[static_cast<std::size_t>(c * n + i)] = values[c];
  }
  return corners;
}

namespace {

using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

// A state as the kernel reads it.
struct Numbers {
  RowMajor3 R;
  Vec3 t;
  explicit Numbers(const SE3& T) : R(T.R()), t(T.t()) {}
};

std::optional<double> run(const ViewQuestion& question, double* gram, double* s, const Lens* other,
                          const SE3* other_T, double* second) {
  const Numbers at(question.T_cam_board), at_other(other_T ? *other_T : question.T_cam_board);
  const ViewCorners& corners = question.corners;
  double farthest = 1;
  const KernelInput in{params(question.lens).data(),
                       at.R.data(),
                       at.t.data(),
                       corners.columns.data(),
                       corners.n_padded(),
                       static_cast<int>(question.loss),
                       question.loss_scale,
                       &farthest,
                       params(other ? *other : question.lens).data(),
                       at_other.R.data(),
                       at_other.t.data()};
  const double cost = best_kernels().functions[question.lens.index()](in, gram, s, second);
  if (!std::isfinite(cost) || !in_domain(question.lens, farthest)) return std::nullopt;
  return cost;
}

std::size_t triangle(int n) { return static_cast<std::size_t>(n * (n + 1) / 2); }

}  // namespace

std::optional<double> accumulate_view(const ViewQuestion& question, MatX* gram) {
  const int n = n_params(question.lens) + 7;
  std::vector<double> lower(gram ? triangle(n) : 0), s;
  if (question.loss == Loss::kCauchy) s.resize(static_cast<std::size_t>(question.corners.n_padded()));
  std::optional<double> cost =
      run(question, gram ? lower.data() : nullptr, s.empty() ? nullptr : s.data(), nullptr, nullptr, nullptr);
  if (!cost) return std::nullopt;
  for (int i = 0; i < question.corners.n && !s.empty(); ++i) {
    *cost += 0.5 * rho(question.loss, question.loss_scale, s[static_cast<std::size_t>(i)]).value;
  }
  if (gram) {
    gram->resize(n, n);
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j <= i; ++j)
        (*gram)(i, j) = (*gram)(j, i) = lower[triangle(i) + static_cast<std::size_t>(j)];
    }
  }
  return cost;
}

std::optional<VecX> accumulate_second(const ViewQuestion& question, const Lens& other_lens,
                                      const SE3& other_T_cam_board) {
  if (!accumulate_view({other_lens, other_T_cam_board, question.corners}, nullptr)) return std::nullopt;
  const int n = n_params(question.lens);
  std::vector<double> lower(triangle(n + 7));
  VecX second(n + 6);
  if (!run(question, lower.data(), nullptr, &other_lens, &other_T_cam_board, second.data()))
    return std::nullopt;
  return second;
}

}  // namespace plumbline::detail
