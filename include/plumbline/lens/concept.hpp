// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <concepts>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

namespace plumbline {

/// d(px)/d(lens parameters) of lens type L: 2 x kNumParams.
template <class L>
using JacParams = Eigen::Matrix<double, 2, L::kNumParams>;

/// d(px)/d(lens parameters) as a list of the parameters that the pixel depends on; never allocates.
struct SparseJac {
  static constexpr int kMost = 4 + 2 * 16;  ///< of a bicubic spline
  int n = 0;
  std::array<int, kMost> index;  ///< index[i] < index[i + 1]
  std::array<Vec2, kMost> J;     ///< d(px)/d(parameter index[i])
  void clear() { n = 0; }
  void add(int parameter, double J_x, double J_y) {
    index[static_cast<std::size_t>(n)] = parameter;
    J[static_cast<std::size_t>(n)] = Vec2(J_x, J_y);
    ++n;
  }
};

/// One row of a lens' own regularisation: sum of weight[i] * parameter[index[i]] should be zero. Rows of one
/// lens weigh against one another as they stand; how much all of them weigh is the solver's business.
struct PriorRow {
  std::array<int, 2> index;
  std::array<double, 2> weight;
};

/// What a lens with a fixed number of parameters must provide. It is a plain struct of doubles, fx fy cx cy
/// first [px], so that the struct IS the solver's parameter block. Adding one costs its header and its name
/// in lens/lens.hpp: names, help, files, solver, reports and tests follow from the list. See docs/lens.md.
///
/// - project: the pixel of a point in the camera frame (x right, y down, z forward; any unit of length), and
/// on
///   request d(px)/d(p_cam) (2x3) and d(px)/d(parameters). nullopt outside the lens' domain: a lens says
///   nothing rather than something wrong. The domain is a cone about the axis.
/// - project_t: the readable definition over any scalar type, without a domain; only tests call it, with
/// automatic
///   differentiation, so that each lens is stated twice.
/// - seed: a lens without distortion and with its centre in the middle, to start a solver from.
template <class L>
concept FixedLens = requires(const L lens, const Vec3& p_cam, Mat23* J_px_p, JacParams<L>* J_px_k,
                             ImageSize size) {
  { L::kName } -> std::convertible_to<std::string_view>;
  { L::kSummary } -> std::convertible_to<std::string_view>;
  requires L::kParamNames.size() == std::size_t(L::kNumParams);
  requires sizeof(L) == sizeof(double) * L::kNumParams;
  { L::kIsCentralPerspective } -> std::convertible_to<bool>;  // only z > 0 projects
  { lens.project(p_cam, J_px_p, J_px_k) } -> std::same_as<std::optional<Vec2>>;
  { L::seed(size, 1.0) } -> std::same_as<L>;
};

/// What a lens must provide whose parameters are counted at run time, because their number depends on options
/// that are part of its name ("splined:30x20:170"). Its derivatives are sparse, it unprojects by itself, and
/// its domain may have any shape. Everyone but the solvers sees it through lens/lens.hpp like any other.
///
/// - make: from the text after "name:", possibly empty, a lens without distortion.
/// - options: the text that makes a lens of the same shape. options_for: a text that suits these rays of an
///   image of this size.
/// - params: fx fy cx cy first [px].
/// - priors: see PriorRow; kHoldsCore: whether a solver must hold fx fy cx cy, because the other parameters
///   can express them.
template <class L>
concept CountedLens = requires(const L lens, L changeable, const Vec3& p_cam, Mat23* J_px_p,
                               SparseJac* J_px_k, ImageSize size) {
  { L::kName } -> std::convertible_to<std::string_view>;
  { L::kSummary } -> std::convertible_to<std::string_view>;
  { L::kIsCentralPerspective } -> std::convertible_to<bool>;
  { L::kHoldsCore } -> std::convertible_to<bool>;
  { lens.params() } -> std::same_as<std::span<const double>>;
  { changeable.params() } -> std::same_as<std::span<double>>;
  { lens.param_names() } -> std::same_as<std::vector<std::string>>;
  { lens.options() } -> std::same_as<std::string>;
  { L::options_for(size, std::span<const Vec3>()) } -> std::same_as<std::string>;
  { lens.priors() } -> std::same_as<std::vector<PriorRow>>;
  { lens.project(p_cam, J_px_p, J_px_k) } -> std::same_as<std::optional<Vec2>>;
  { lens.unproject(Vec2()) } -> std::same_as<std::optional<Vec3>>;
  { L::make(std::string_view(), size, 1.0) } -> std::same_as<Result<L>>;
};

template <class L>
concept LensModel = FixedLens<L> || CountedLens<L>;

}  // namespace plumbline
