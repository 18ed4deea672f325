// SPDX-License-Identifier: Apache-2.0
#include "refine/radial_guard.hpp"

#include <ceres/cost_function.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace plumbline::detail {
namespace {

constexpr int kSteps = 24, kRows = kGuardDirections * kSteps;
constexpr double kWeight = 100;  // [1/px]

// Distance of a pixel from the centre along its direction.
template <class L>
struct Radius {
  double px = 0;
  std::array<double, L::kNumParams> J_k{};

  Radius(const L& lens, double distance, int direction) {
    const double around = direction * std::numbers::pi / 4, c = std::cos(around), s = std::sin(around);
    const double across = L::kIsCentralPerspective ? distance : std::sin(distance);
    const double ahead = L::kIsCentralPerspective ? 1.0 : std::cos(distance);
    double m[2], J_m_d[2 * (L::kNumParams - 4) + 1];
    lens.distort(across * c, across * s, ahead, m, static_cast<double*>(nullptr), J_m_d);
    px = c * lens.fx * m[0] + s * lens.fy * m[1];
    J_k[0] = c * m[0], J_k[1] = s * m[1];  // the centre moves both ends of a step
    for (int p = 4; p < L::kNumParams; ++p)
      J_k[p] = c * lens.fx * J_m_d[2 * (p - 4)] + s * lens.fy * J_m_d[2 * (p - 4) + 1];
  }
};

// The residuals, and their derivatives row by row unless J is null. One-sided: zero where the lens rises
// enough; else negative there.
template <bool kOneSided, class L>
void write_rows(const L& lens, const RadialGuard& guard, double* residuals, double* J) {
  for (int i = 0; i < kGuardDirections; ++i) {
    const double step = (guard.to[i] - guard.from) / kSteps, least_px = guard.least_slope_px * step;
    Radius<L> before(lens, guard.from, i);
    for (int k = 0; k < kSteps; ++k) {
      const int row = i * kSteps + k;
      const Radius<L> after(lens, guard.from + (k + 1) * step, i);
      const double lacks_px = least_px - (after.px - before.px);
      const bool counts = !kOneSided || lacks_px > 0;
      residuals[row] = std::isfinite(lacks_px) ? (counts ? kWeight * lacks_px : 0.0) : NAN;
      for (int p = 0; J && p < L::kNumParams; ++p)
        J[row * L::kNumParams + p] = counts ? kWeight * (before.J_k[p] - after.J_k[p]) : 0.0;
      before = after;
    }
  }
}

template <class L>
class RadialGuardCost final : public ceres::CostFunction {
 public:
  explicit RadialGuardCost(const RadialGuard& guard) : guard_(guard) {
    set_num_residuals(kRows);
    mutable_parameter_block_sizes()->push_back(L::kNumParams);
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    L lens;
    std::copy_n(parameters[0], L::kNumParams, &lens.fx);
    write_rows<true>(lens, guard_, residuals, jacobians ? jacobians[0] : nullptr);
    return std::all_of(residuals, residuals + kRows, [](double r) { return std::isfinite(r); });
  }

 private:
  RadialGuard guard_;
};

template <class L>
concept HasClosedForm = FixedLens<L> && requires(const L lens, double x, double* out) {
  lens.distort(x, x, x, out, out, out);
};

}  // namespace

GuardRows guard_rows(const Lens& lens, const RadialGuard& guard) {
  return std::visit(
      [&]<class L>([[maybe_unused]] const L& fixed) -> GuardRows {
        if constexpr (HasClosedForm<L>) {
          GuardRows rows{VecX(kRows), {}};
          Eigen::Matrix<double, kRows, L::kNumParams, Eigen::RowMajor> J;
          write_rows<false>(fixed, guard, rows.r.data(), J.data());
          rows.J = J;
          return rows;
        } else {
          return {VecX(0), MatX(0, n_params(lens))};
        }
      },
      lens);
}

GuardRows one_sided(GuardRows rows) {
  for (Eigen::Index i = 0; i < rows.r.size(); ++i) {
    if (!(rows.r[i] <= 0)) continue;  // what is not a number stays
    rows.r[i] = 0;
    rows.J.row(i).setZero();
  }
  return rows;
}

bool can_guard(const Lens& lens) {
  return std::visit([]<class L>(const L&) { return HasClosedForm<L>; }, lens);
}

std::unique_ptr<ceres::CostFunction> make_radial_guard(const Lens& lens, const RadialGuard& guard) {
  return std::visit(
      [&]<class L>(const L&) -> std::unique_ptr<ceres::CostFunction> {
        if constexpr (HasClosedForm<L>) {
          return std::make_unique<RadialGuardCost<L>>(guard);
        } else {
          return nullptr;
        }
      },
      lens);
}

}  // namespace plumbline::detail
