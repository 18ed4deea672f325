// SPDX-License-Identifier: Apache-2.0
#include "refine/radial_guard.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace plumbline::detail {
namespace {

constexpr int kSteps = 24;
constexpr double kWeight = 100;  // [1/px]

template <FixedLens L>
class RadialGuardCost final : public ceres::CostFunction {
 public:
  explicit RadialGuardCost(const RadialGuard& guard) : guard_(guard) {
    set_num_residuals(kGuardDirections * kSteps);
    mutable_parameter_block_sizes()->push_back(L::kNumParams);
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    L lens;
    std::copy_n(parameters[0], L::kNumParams, &lens.fx);
    double* const J = jacobians ? jacobians[0] : nullptr;
    for (int i = 0; i < kGuardDirections; ++i) {
      const double step = (guard_.to[i] - guard_.from) / kSteps, least_px = guard_.least_slope_px * step;
      Radius before = radius(lens, guard_.from, i);
      for (int k = 0; k < kSteps; ++k) {
        const int row = i * kSteps + k;
        const Radius after = radius(lens, guard_.from + (k + 1) * step, i);
        const double lacks_px = least_px - (after.px - before.px);
        if (!std::isfinite(lacks_px)) return false;
        residuals[row] = kWeight * std::max(0.0, lacks_px);
        for (int p = 0; J && p < L::kNumParams; ++p)
          J[row * L::kNumParams + p] = lacks_px > 0 ? kWeight * (before.J_k[p] - after.J_k[p]) : 0.0;
        before = after;
      }
    }
    return true;
  }

 private:
  // Distance of the pixel from the centre along its direction.
  struct Radius {
    double px = 0;
    std::array<double, L::kNumParams> J_k{};
  };

  static Radius radius(const L& lens, double distance, int direction) {
    const double around = direction * std::numbers::pi / 4, c = std::cos(around), s = std::sin(around);
    const double across = L::kIsCentralPerspective ? distance : std::sin(distance);
    const double ahead = L::kIsCentralPerspective ? 1.0 : std::cos(distance);
    double m[2], J_m_d[2 * (L::kNumParams - 4) + 1];
    lens.distort(across * c, across * s, ahead, m, static_cast<double*>(nullptr), J_m_d);
    Radius out{c * lens.fx * m[0] + s * lens.fy * m[1], {}};
    out.J_k[0] = c * m[0], out.J_k[1] = s * m[1];  // the centre moves both ends of a step
    for (int p = 4; p < L::kNumParams; ++p)
      out.J_k[p] = c * lens.fx * J_m_d[2 * (p - 4)] + s * lens.fy * J_m_d[2 * (p - 4) + 1];
    return out;
  }

  RadialGuard guard_;
};

template <class L>
concept HasClosedForm = requires(const L lens, double x, double* out) {
  lens.distort(x, x, x, out, out, out);
};

}  // namespace

std::unique_ptr<ceres::CostFunction> make_radial_guard(const Lens& lens, const RadialGuard& guard) {
  return std::visit(
      [&]<class L>(const L&) -> std::unique_ptr<ceres::CostFunction> {
        if constexpr (FixedLens<L> && HasClosedForm<L>) {
          return std::make_unique<RadialGuardCost<L>>(guard);
        } else {
          return nullptr;
        }
      },
      lens);
}

}  // namespace plumbline::detail
