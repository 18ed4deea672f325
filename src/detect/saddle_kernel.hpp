// SPDX-License-Identifier: Apache-2.0
#pragma once

/// The inner loop of fit_saddle(): the normal equations of two blurred edges through one point, several
/// pixels at a time. Compiled once for each instruction set; the widest that the processor has is chosen when
/// the program runs. Files compiled for more than the baseline must not emit functions that another file
/// could be linked to (tests/architecture reads their symbols), so nothing is included here.
namespace plumbline::detail {

/// Corner x, y; directions of the edges; blur; mean, half step, slopes of the light along x and y.
constexpr int kSaddleParams = 9;
/// The derivatives of a pixel and its residual.
constexpr int kSaddleColumns = kSaddleParams + 1;
/// Pixels are padded to a multiple of this with ones of weight 0.
constexpr int kSaddlePad = 16;

/// The pixels of a window in columns of n_padded numbers. Places are relative to a pixel near the corner, so
/// that single precision resolves them to a millionth of a pixel.
struct SaddlePixels {
  const float *x, *y, *grey, *weight;
  int n_padded;
};

/// A state of the model as the kernel reads it; x, y are relative as those of the pixels.
struct SaddleModel {
  float x, y;
  float cos1, sin1, cos2, sin2;  ///< of the directions of the edges
  float inverse_blur, mean, step, slope_x, slope_y;
  float bend1, bend2;  ///< half the edges' curvatures [1/px]
};

/// `lower`: the lower triangle, row by row, of the gram of the columns [derivatives of the model by its
/// parameters | residual]; the last entry is the sum of squares. `columns`: room for kSaddleColumns times
/// n_padded numbers.
using SumSaddleFunction = void (*)(const SaddlePixels& pixels, const SaddleModel& model, float* columns,
                                   float* lower);

struct SaddleKernels {
  const char* name;
  SumSaddleFunction sum;
};

extern const SaddleKernels kBaselineSaddleKernels;
extern const SaddleKernels kAvx2SaddleKernels, kAvx512SaddleKernels;  ///< defined on x86-64 only

/// The widest that this processor has.
const SaddleKernels& best_saddle_kernels();

}  // namespace plumbline::detail
