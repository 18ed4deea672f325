// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <optional>
#include <vector>

#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"
#include "plumbline/refine/refine.hpp"
#include "refine/reprojection_cost.hpp"

/// The inner loop of the block solver: residuals and derivatives of all corners of one view, summed straight
/// into one small symmetric matrix, several corners at a time. Compiled once for each instruction set; the
/// widest that the processor has is chosen when the program runs. No Jacobian is stored.
namespace plumbline::detail {

/// The corners of one view in columns, padded with corners of weight 0 to a multiple of kPad.
struct ViewCorners {
  static constexpr int kPad = 8;
  int n = 0;           ///< without the padding
  bool bowed = false;  ///< the board's bow is a parameter
  /// X, Y, Z [m, board, flat], weight, and of a bowed board the two of Observation::bow_shape: four or six
  /// columns of n_padded() numbers. Views that see the same points share them.
  std::shared_ptr<const std::vector<double>> points;
  std::vector<double> px;  ///< u, v [px]: two such columns
  int n_padded() const { return (n + kPad - 1) / kPad * kPad; }
};

ViewCorners view_corners(const std::vector<Observation>& observations, bool bowed = false);

/// What one view asks of the kernel.
struct ViewQuestion {
  const Lens& lens;
  SE3 T_cam_board;
  const ViewCorners& corners;
  Loss loss = Loss::kSquared;
  double loss_scale = 1;
  Vec2 bow_m = Vec2::Zero();  ///< of a bowed board; of others not read
};

/// The lower triangle, row by row, of a symmetric matrix that holds the largest gram there is.
struct Gram {
  static constexpr int kMost = kMaxLensParams + 9;
  double lower[kMost * (kMost + 1) / 2];
  double operator()(int i, int j) const { return lower[i * (i + 1) / 2 + j]; }  ///< \pre i >= j
};

/// Sum over the corners of rho' J'J, J of size 2 x (n_params + 7), columns [lens parameters | dw dt |
/// residual], where [dw (rad) | dt (m)] moves the board in the CAMERA's frame: R <- exp(dw) R, t <- t + dt
/// for T_cam_board. Of a bowed board J has two more columns at its end, of the two numbers of the bow [m].
/// rho' is the derivative of the loss (iterated re-weighting). Returns half the sum of rho,
/// or nullopt when a corner lies outside the lens' domain or a number is not finite; `gram` then means
/// nothing. With gram == nullptr only the cost.
std::optional<double> accumulate_view(const ViewQuestion& question, Gram* gram);

/// J' W r of the same columns without the residual's (n_params + 6, or + 8), with derivatives J and weights W
/// = rho' of the question's state and residuals r of another one; nullopt when a corner lies outside a lens'
/// domain.
std::optional<VecX> accumulate_second(const ViewQuestion& question, const Lens& other_lens,
                                      const SE3& other_T_cam_board, const Vec2& other_bow_m = Vec2::Zero());

/// "avx512", "avx2" or "baseline": the instruction set that is used here.
const char* kernel_name();

}  // namespace plumbline::detail
