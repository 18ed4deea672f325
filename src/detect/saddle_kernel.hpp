// SPDX-License-Identifier: Apache-2.0
#pragma once

/// The inner loops of find_saddles() and fit_saddle(), several pixels at a time. Compiled once for each
/// instruction set; the widest that the processor has is chosen when the program runs. Files compiled for
/// more than the baseline must not emit functions that another file could be linked to (tests/architecture
/// reads their symbols), so nothing is included here.
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

/// Minus the determinant of the second differences over kSaddleStep pixels, for the pixels from kSaddleStep
/// to n - kSaddleStep of an image row; `above` and `below` are the rows kSaddleStep away.
constexpr int kSaddleStep = 2;
using RespondFunction = void (*)(const unsigned char* above, const unsigned char* here,
                                 const unsigned char* below, int n, float* out);

/// The x in [first, last) at which a row has a value of `least` or more that no neighbour within the row
/// exceeds (of two equal ones the right one); returns how many there are.
using PeaksFunction = int (*)(const float* row, int first, int last, float least, int* out);

struct SaddleKernels {
  const char* name;
  SumSaddleFunction sum;
  RespondFunction respond;
  PeaksFunction peaks;
};

extern const SaddleKernels kBaselineSaddleKernels;
extern const SaddleKernels kAvx2SaddleKernels, kAvx512SaddleKernels;  ///< defined on x86-64 only

/// The widest that this processor has.
const SaddleKernels& best_saddle_kernels();

}  // namespace plumbline::detail
