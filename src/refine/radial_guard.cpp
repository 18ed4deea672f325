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

template <class L>
GuardRows rows_of(const L& lens, const RadialGuard& guard) {
  GuardRows rows{VecX(kRows), MatX(kRows, L::kNumParams)};
  for (int i = 0; i < kGuardDirections; ++i) {
    const double step = (guard.to[i] - guard.from) / kSteps, least_px = guard.least_slope_px * step;
    Radius<L> before(lens, guard.from, i);
    for (int k = 0; k < kSteps; ++k) {
      const int row = i * kSteps + k;
      const Radius<L> after(lens, guard.from + (k + 1) * step, i);
      const double lacks_px = least_px - (after.px - before.px);
      rows.r[row] = std::isfinite(lacks_px) ? kWeight * lacks_px : NAN;
      for (int p = 0; p < L::kNumParams; ++p) rows.J(row, p) = kWeight * (before.J_k[p] - after.J_k[p]);
      before = after;
    }
  }
  return rows;
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
    const GuardRows rows = one_sided(rows_of(lens, guard_));
    if (!rows.r.allFinite()) return false;
    std::copy_n(rows.r.data(), kRows, residuals);
    if (!jacobians || !jacobians[0]) return true;
    Eigen::Map<Eigen::Matrix<double, kRows, L::kNumParams, Eigen::RowMajor>> J(jacobians[0]);
    J = rows.J;
    return true;
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
          return rows_of(fixed, guard);
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
