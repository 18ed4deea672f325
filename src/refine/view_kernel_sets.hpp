// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "plumbline/lens/lens.hpp"

/// One entry for each instruction set that the kernels are compiled for. The files that are compiled for more
/// than the baseline must not emit any function that another file could be linked to (an inline function of a
/// shared header, say): tests/architecture reads their symbols.
namespace plumbline::detail {

/// One state of a lens and a board: parameters, R_cam_board row by row, t_cam_board.
struct KernelState {
  const double *k, *R, *t;
};

struct KernelInput {
  KernelState at;
  KernelState second;    ///< another state, whose residuals are wanted too; read only with `second`
  const double* points;  ///< X, Y, Z, weight: four columns of n_padded numbers
  const double* px;      ///< u, v: two such columns
  int n_padded;
  int loss;  ///< 0 squared, 1 Huber, 2 Cauchy
  double loss_scale;
  /// How far each number of a bow lifts the points along z: two columns of n_padded numbers; null: no bow is
  /// a parameter. `points` are where the present bow has put them.
  const double* bow_shape = nullptr;
  const double* second_points = nullptr;  ///< X, Y, Z of the second state; read only with `second`
};

/// What a kernel says besides its sums.
struct KernelAnswer {
  double cost;  ///< half the sum of rho (squared and Huber), 0 for Cauchy
  double far_z,
      far_nn;  ///< z |z| and |p_cam|^2 of the corner farthest from the axis, the padding counted too
};

/// Lower triangle (row by row, n_params + 7 rows, and two more for a bow) of the gram, or nothing when `gram`
/// is null. `s` (n_padded, may be null) takes the squared weighted residuals, for a loss whose value is not
/// summed here. `second` (n_params + 6, and two more for a bow; may be null, needs `gram`, which then means
/// nothing) takes the products of this state's weighted derivatives with the second state's weighted
/// residuals.
using KernelFunction = KernelAnswer (*)(const KernelInput&, double* gram, double* s, double* second);

/// Consecutive shared parameters that a frame depends on: `n` of them from `first`.
struct Segment {
  int first, n;
};

/// Eliminates a board pose. A (6 x 6, only its lower triangle is read) becomes its Cholesky factor L; B (6
/// columns of `rows` numbers, the rows in the order of the segments) becomes B L^-T; B B' is added to the
/// lower triangle of S (column by column, S_rows to a column) at the segments. False when A is not positive
/// definite.
using EliminateFunction = bool (*)(double* A, double* B, int rows, const Segment* segments, int n_segments,
                                   double* S, int S_rows);

/// The functions of one instruction set, the kernels in the order of the list Lens.
struct KernelSet {
  const char* name;
  int width;  ///< doubles at a time
  EliminateFunction eliminate;
  KernelFunction functions[std::variant_size_v<Lens>];
};

extern const KernelSet kBaselineKernels;
extern const KernelSet kAvx2Kernels, kAvx512Kernels;  ///< defined on x86-64 only

/// The widest set that this processor has.
const KernelSet& best_kernels();

}  // namespace plumbline::detail
