// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "plumbline/lens/lens.hpp"

/// One entry for each instruction set that the kernel is compiled for. The files that are compiled for more
/// than the baseline must not emit any function that another file could be linked to (an inline function of a
/// shared header, say): tests/architecture reads their symbols.
namespace plumbline::detail {

struct KernelInput {
  const double* k;        ///< lens parameters
  const double* R;        ///< R_cam_board, row by row
  const double* t;        ///< t_cam_board
  const double* columns;  ///< ViewCorners
  int n_padded;
  int loss;  ///< 0 squared, 1 Huber, 2 Cauchy
  double loss_scale;
  double*
      farthest;  ///< out: least z |z| / |p_cam|^2, which tells the angle of the corner farthest from the axis
  const double *second_k, *second_R, *second_t;  ///< of a second state; read only with `second`
};

/// Lower triangle (row by row, n_params + 7 rows) of the gram, or nothing when `gram` is null. `s` (n_padded,
/// may be null) takes the squared weighted residuals, for a loss whose value is not summed here. Returns half
/// the sum of rho (squared and Huber), 0 for Cauchy.
/// `second` (n_params + 6, may be null, needs `gram`) takes the products of this state's weighted derivatives
/// with the second state's weighted residuals.
using KernelFunction = double (*)(const KernelInput&, double* gram, double* s, double* second);

/// The functions of one instruction set, in the order of the list Lens.
struct KernelSet {
  const char* name;
  int width;  ///< doubles at a time
  KernelFunction functions[std::variant_size_v<Lens>];
};

extern const KernelSet kBaselineKernels;
#ifdef PLUMBLINE_X86_KERNELS
extern const KernelSet kAvx2Kernels, kAvx512Kernels;
#endif

}  // namespace plumbline::detail
