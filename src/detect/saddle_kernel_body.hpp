// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "detect/saddle_kernel.hpp"

// Included by one file for each instruction set, which says how many floats make a pack. Everything has
// internal linkage.
namespace plumbline::detail {
namespace {

constexpr int kWidth = PLUMBLINE_PACK;
typedef float Floats __attribute__((vector_size(sizeof(float) * PLUMBLINE_PACK)));
typedef int Ints __attribute__((vector_size(sizeof(float) * PLUMBLINE_PACK)));

#define PLUMBLINE_INLINE inline __attribute__((always_inline))

PLUMBLINE_INLINE Floats load(const float* p) {
  Floats a;
  __builtin_memcpy(&a, p, sizeof a);
  return a;
}

PLUMBLINE_INLINE void store(float* p, Floats a) { __builtin_memcpy(p, &a, sizeof a); }

PLUMBLINE_INLINE float total(Floats a) {
  float sum = 0;
  for (int i = 0; i < kWidth; ++i) sum += a[i];
  return sum;
}

/// exp(-u), u in [0, 80], to 3e-7 of itself: a power of two times the Taylor series of 2^f, f in (-1, 0].
PLUMBLINE_INLINE Floats exp_of_minus(Floats u) {
  const Floats t = u * -1.44269504F;
  const Ints whole = __builtin_convertvector(t, Ints);  // towards zero
  const Floats f = (t - __builtin_convertvector(whole, Floats)) * 0.693147181F;
  Floats p = f * (1.0F / 40320) + 1.0F / 5040;
  p = p * f + 1.0F / 720;
  p = p * f + 1.0F / 120;
  p = p * f + 1.0F / 24;
  p = p * f + 1.0F / 6;
  p = p * f + 0.5F;
  p = p * f + 1.0F;
  p = p * f + 1.0F;
  const Ints power = (whole + 127) << 23;
  Floats scale;
  __builtin_memcpy(&scale, &power, sizeof scale);
  return p * scale;
}

struct Edge {
  Floats value, slope;
};

/// erf(z / sqrt 2) and its derivative. Abramowitz & Stegun 1964, 7.1.26: to 1.5e-7.
PLUMBLINE_INLINE Edge edge(Floats z) {
  const Floats square = z * z * 0.5F;
  const Floats e = exp_of_minus(square < 80.0F ? square : Floats{} + 80.0F);
  const Floats size = z < 0.0F ? -z : z;
  const Floats t = 1.0F / (1.0F + (0.3275911F * 0.707106781F) * size);
  const Floats tail =
      ((((1.061405429F * t - 1.453152027F) * t + 1.421413741F) * t - 0.284496736F) * t + 0.254829592F) * t *
      e;
  const Floats value = 1.0F - tail;
  return {z < 0.0F ? -value : value, 0.797884561F * e};
}

/// The weighted derivatives and residuals of all pixels.
PLUMBLINE_INLINE void fill(const SaddlePixels& pixels, const SaddleModel& m, float* columns) {
  for (int i = 0; i < pixels.n_padded; i += kWidth) {
    const Floats dx = load(pixels.x + i) - m.x, dy = load(pixels.y + i) - m.y, w = load(pixels.weight + i);
    const Floats along1 = m.cos1 * dx + m.sin1 * dy, along2 = m.cos2 * dx + m.sin2 * dy;
    const Floats z1 = (m.cos1 * dy - m.sin1 * dx - m.bend1 * along1 * along1) * m.inverse_blur;
    const Floats z2 = (m.cos2 * dy - m.sin2 * dx - m.bend2 * along2 * along2) * m.inverse_blur;
    const Edge e1 = edge(z1), e2 = edge(z2);
    // The field where both board offsets have one sign lies on different sides of the two edges.
    const Floats shape = -e1.value * e2.value;
    const float k = -m.step * m.inverse_blur;
    const Floats d1 = w * k * e1.slope * e2.value, d2 = w * k * e1.value * e2.slope;
    const Floats columns_here[kSaddleColumns] = {
        d1 * m.sin1 + d2 * m.sin2,
        -d1 * m.cos1 - d2 * m.cos2,
        -d1 * along1,
        -d2 * along2,
        -d1 * z1 - d2 * z2,
        w,
        w * shape,
        w * dx,
        w * dy,
        w * (load(pixels.grey + i) - (m.mean + m.step * shape + m.slope_x * dx + m.slope_y * dy))};
    for (int c = 0; c < kSaddleColumns; ++c) store(columns + c * pixels.n_padded + i, columns_here[c]);
  }
}

/// Rows `row` and `row + 1` of the gram, columns [kFirst, kFirst + kN).
template <int kN>
PLUMBLINE_INLINE void sum_block(const float* columns, int n, int row, int first, float* lower) {
  Floats a[kN] = {}, b[kN] = {};
  for (int i = 0; i < n; i += kWidth) {
    const Floats u = load(columns + row * n + i), v = load(columns + (row + 1) * n + i);
    for (int c = 0; c < kN; ++c) {
      const Floats other = load(columns + (first + c) * n + i);
      a[c] += u * other;
      b[c] += v * other;
    }
  }
  for (int c = 0; c < kN; ++c) {
    if (first + c <= row) lower[row * (row + 1) / 2 + first + c] = total(a[c]);
    lower[(row + 1) * (row + 2) / 2 + first + c] = total(b[c]);
  }
}

void sum(const SaddlePixels& pixels, const SaddleModel& model, float* columns, float* lower) {
  fill(pixels, model, columns);
  const int n = pixels.n_padded;
  sum_block<2>(columns, n, 0, 0, lower);
  sum_block<4>(columns, n, 2, 0, lower);
  sum_block<6>(columns, n, 4, 0, lower);
  sum_block<4>(columns, n, 6, 0, lower);
  sum_block<4>(columns, n, 6, 4, lower);
  sum_block<5>(columns, n, 8, 0, lower);
  sum_block<5>(columns, n, 8, 5, lower);
}

void respond(const unsigned char* above, const unsigned char* here, const unsigned char* below, int n,
             float* out) {
  constexpr int k = kSaddleStep;
  for (int x = k; x < n - k; ++x) {
    const int middle = 2 * here[x];
    const auto xx = static_cast<float>(here[x - k] + here[x + k] - middle);
    const auto yy = static_cast<float>(above[x] + below[x] - middle);
    const auto xy = static_cast<float>(above[x - k] + below[x + k] - above[x + k] - below[x - k]);
    out[x] = 0.0625F * xy * xy - xx * yy;
  }
}

/// The largest of kStretch values.
constexpr int kStretch = 64;
PLUMBLINE_INLINE float largest(const float* row) {
  Floats most = load(row);
  for (int i = kWidth; i < kStretch; i += kWidth) {
    const Floats other = load(row + i);
    most = other > most ? other : most;
  }
  float out = most[0];
  for (int i = 1; i < kWidth; ++i) out = most[i] > out ? most[i] : out;
  return out;
}

int peaks(const float* row, int first, int last, float least, int* out) {
  int n = 0;
  for (int x0 = first; x0 < last; x0 += kStretch) {
    const int x1 = x0 + kStretch < last ? x0 + kStretch : last;
    // Most stretches of most images hold nothing.
    if (x1 - x0 == kStretch && !(largest(row + x0) >= least)) continue;
    unsigned char is_peak[kStretch] = {};
    for (int x = x0; x < x1; ++x) {
      const float here = row[x];
      is_peak[x - x0] =
          static_cast<unsigned char>((here >= least) & (here >= row[x - 1]) & (here > row[x + 1]));
    }
    for (int i = 0; i < kStretch; i += 8) {
      unsigned long long eight;
      __builtin_memcpy(&eight, is_peak + i, sizeof eight);
      if (eight == 0) continue;
      for (int k = i; k < i + 8; ++k) {
        if (is_peak[k] != 0) out[n++] = x0 + k;
      }
    }
  }
  return n;
}

}  // namespace
}  // namespace plumbline::detail
