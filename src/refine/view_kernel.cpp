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

ViewCorners view_corners(const std::vector<Observation>& observations, bool bowed) {
  ViewCorners corners;
  corners.n = static_cast<int>(observations.size());
  corners.bowed = bowed;
  const auto n = static_cast<std::size_t>(corners.n_padded());
  std::vector<double> points((bowed ? 6 : 4) * n);
  corners.px.resize(2 * n);
  for (std::size_t i = 0; i < n; ++i) {
    const Observation& o = observations[std::min(i, observations.size() - 1)];
    for (std::size_t c = 0; c < 3; ++c) points[c * n + i] = o.p_board[static_cast<Eigen::Index>(c)];
    points[3 * n + i] = i < observations.size() ? o.weight : 0.0;
    for (std::size_t b = 0; bowed && b < 2; ++b)
      points[(4 + b) * n + i] = o.bow_shape[static_cast<Eigen::Index>(b)];
    corners.px[i] = o.px.x();
    corners.px[n + i] = o.px.y();
  }
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

// The points of a view where a bow puts them, as four columns. Flat ones stay where they are.
class Lifted {
 public:
  Lifted(const ViewCorners& corners, const Vec2& bow_m) : data_(corners.points->data()) {
    if (!corners.bowed) return;
    const auto n = static_cast<std::size_t>(corners.n_padded());
    own_.assign(data_, data_ + 4 * n);
    for (std::size_t i = 0; i < n; ++i)
      own_[2 * n + i] += bow_m.x() * data_[4 * n + i] + bow_m.y() * data_[5 * n + i];
    data_ = own_.data();
  }
  Lifted(const Lifted&) = delete;
  Lifted& operator=(const Lifted&) = delete;
  const double* data() const { return data_; }

 private:
  std::vector<double> own_;
  const double* data_;
};

KernelInput input_of(const ViewQuestion& q, const Lifted& points, const KernelState& at) {
  return {.at = at,
          .second = {},
          .points = points.data(),
          .px = q.corners.px.data(),
          .n_padded = q.corners.n_padded(),
          .loss = static_cast<int>(q.loss),
          .loss_scale = q.loss_scale,
          .bow_shape = q.corners.bowed ? q.corners.points->data() + 4 * q.corners.n_padded() : nullptr};
}

bool usable(const Lens& lens, const KernelAnswer& answer) {
  return std::isfinite(answer.cost) && in_domain(lens, answer);
}

}  // namespace

std::optional<double> accumulate_view(const ViewQuestion& question, Gram* gram) {
  std::vector<double> s;
  if (question.loss == Loss::kCauchy) s.resize(static_cast<std::size_t>(question.corners.n_padded()));
  const Numbers at(question.T_cam_board);
  const Lifted points(question.corners, question.bow_m);
  const KernelInput in = input_of(question, points, at.with(question.lens));
  const KernelAnswer answer = best_kernels().functions[question.lens.index()](
      in, gram ? gram->lower : nullptr, s.empty() ? nullptr : s.data(), nullptr);
  double cost = answer.cost;
  for (int i = 0; i < question.corners.n && !s.empty(); ++i)
    cost += 0.5 * rho(question.loss, question.loss_scale, s[static_cast<std::size_t>(i)]).value;
  if (!usable(question.lens, answer) || !std::isfinite(cost)) return std::nullopt;
  return cost;
}

std::optional<VecX> accumulate_second(const ViewQuestion& question, const Lens& other_lens,
                                      const SE3& other_T_cam_board, const Vec2& other_bow_m) {
  const ViewCorners& corners = question.corners;
  if (!accumulate_view(
          {.lens = other_lens, .T_cam_board = other_T_cam_board, .corners = corners, .bow_m = other_bow_m},
          nullptr))
    return std::nullopt;
  const Numbers at(question.T_cam_board), second(other_T_cam_board);
  const Lifted points(corners, question.bow_m), second_points(corners, other_bow_m);
  KernelInput in = input_of(question, points, at.with(question.lens));
  in.second = second.with(other_lens);
  in.second_points = second_points.data();
  Gram gram;
  VecX products(n_params(question.lens) + (corners.bowed ? 8 : 6));
  const KernelAnswer answer =
      best_kernels().functions[question.lens.index()](in, gram.lower, nullptr, products.data());
  if (!usable(question.lens, answer)) return std::nullopt;
  return products;
}

}  // namespace plumbline::detail
