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
};

/// What a kernel says besides its sums.
struct KernelAnswer {
  double cost;  ///< half the sum of rho (squared and Huber), 0 for Cauchy
  double far_z,
      far_nn;  ///< z |z| and |p_cam|^2 of the corner farthest from the axis, the padding counted too
};

/// Lower triangle (row by row, n_params + 7 rows) of the gram, or nothing when `gram` is null. `s` (n_padded,
/// may be null) takes the squared weighted residuals, for a loss whose value is not summed here.
/// `second` (n_params + 6, may be null, needs `gram`) takes the products of this state's weighted derivatives
/// with the second state's weighted residuals.
using KernelFunction = KernelAnswer (*)(const KernelInput&, double* gram, double* s, double* second);

/// Consecutive shared parameters that a frame depends on: `n` of them from `first`.
struct Segment {
  int first, n;
};

/// Eliminates a board pose. A (6 x 6, only its lower triangle is read) becomes its Cholesky factor L; B (6
/// columns of `rows` numbers) becomes B L^-T. False when A is not positive definite.
using EliminateFunction = bool (*)(double* A, double* B, int rows);

/// Adds B B' to the lower triangle of S (column by column, S_rows to a column) at the segments, in whose
/// order the rows of B are, in the columns from `first` to before `end`.
using AddOuterFunction = void (*)(const double* B, int rows, const Segment* segments, int n_segments,
                                  double* S, int S_rows, int first, int end);

/// One view of a splined lens. Its control points depend on where each corner lies, which is found before
/// (spline_view.hpp), so that no rounding of the kernel's can put a corner elsewhere.
struct SplineInput {
  KernelState at;
  int order, n_x, n_y;
  double knots_per_unit;
  const double* points;  ///< as in KernelInput
  const double* px;
  int n, n_padded;         ///< corners, and the length of their columns
  const int* first_knots;  ///< of each corner: x, y
  const int*
      row_of_knots;  ///< of each row of knots: control point i's x is at this + 2 i in SplineOutput::control
  int n_rows;
  int loss;
  double loss_scale;
};

/// Columns of a corner's Jacobian row besides the control points: focal length, centre, dw dt, residual.
constexpr int kSplineColumns = 9;
/// Rows of the gram: fx fy cx cy, dw dt, residual.
constexpr int kSplineGram = 11;
/// A knot and another of at most three rows below: 7 (row below) + 3 + (columns to the right of it).
constexpr int kSplineBand = 28;

struct SplineOutput {
  double* gram;  ///< lower triangle, row by row
  /// Added to: of each knot kSplineBand sums of products of its and another knot's weights. Times fx^2 this
  /// is what their x have with each other, times fy^2 their y.
  double* band;
  double* control;  ///< added to: kSplineColumns columns of n_rows, the control points' products with those
};

/// Half the sum of rho; NaN when the surface is folded at a corner.
using SplineFunction = double (*)(const SplineInput&, const SplineOutput&);

/// The functions of one instruction set, the kernels in the order of the list Lens.
struct KernelSet {
  const char* name;
  int width;  ///< doubles at a time
  EliminateFunction eliminate;
  AddOuterFunction add_outer;
  SplineFunction spline;
  KernelFunction functions[std::variant_size_v<Lens>];
};

extern const KernelSet kBaselineKernels;
extern const KernelSet kAvx2Kernels, kAvx512Kernels;  ///< defined on x86-64 only

/// The widest set that this processor has.
const KernelSet& best_kernels();

}  // namespace plumbline::detail
