// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <concepts>
#include <cstddef>
#include <optional>
#include <string_view>

#include "plumbline/core/types.hpp"

namespace plumbline {

/// d(px)/d(lens parameters) of lens type L: 2 x kNumParams.
template <class L>
using JacParams = Eigen::Matrix<double, 2, L::kNumParams>;

/// What a lens must provide. A lens is a plain struct of doubles, fx fy cx cy first [px], so that the struct
/// IS the solver's parameter block. Adding one costs its header and its name in lens/lens.hpp: names, help,
/// files, solver, reports and tests follow from the list. See docs/lens.md.
///
/// - project: the pixel of a point in the camera frame (x right, y down, z forward; any unit of length), and
/// on
///   request d(px)/d(p_cam) (2x3) and d(px)/d(parameters). nullopt outside the lens' domain: a lens says
///   nothing rather than something wrong.
/// - project_t: the readable definition over any scalar type, without a domain; only tests call it, with
/// automatic
///   differentiation, so that each lens is stated twice.
/// - seed: a lens without distortion and with its centre in the middle, to start a solver from.
///
/// A lens whose parameters are counted at run time (a spline) will join the list by answering the same free
/// functions of lens/lens.hpp, which ask the value, not the type, for its parameters.
template <class L>
concept LensModel = requires(const L lens, const Vec3& p_cam, Mat23* J_px_p, JacParams<L>* J_px_k,
                             ImageSize size) {
  { L::kName } -> std::convertible_to<std::string_view>;
  { L::kSummary } -> std::convertible_to<std::string_view>;
  requires L::kParamNames.size() == std::size_t(L::kNumParams);
  requires sizeof(L) == sizeof(double) * L::kNumParams;
  { L::kIsCentralPerspective } -> std::convertible_to<bool>;  // only z > 0 projects
  { lens.project(p_cam, J_px_p, J_px_k) } -> std::same_as<std::optional<Vec2>>;
  { L::seed(size, 1.0) } -> std::same_as<L>;
};

}  // namespace plumbline
