// SPDX-License-Identifier: Apache-2.0
// The kernel itself, included once by each view_kernel_*.cpp, which says PLUMBLINE_PACK (doubles at a time)
// and PLUMBLINE_KERNELS (the name of its KernelSet). No #pragma once and internal linkage on purpose: see
// view_kernel_sets.hpp.
#include <utility>

#include "refine/view_kernel_pack.hpp"
#include "refine/view_kernel_sets.hpp"

namespace plumbline::detail {
namespace {

// Corners whose Jacobian columns stay in the first-level cache.
constexpr int kChunk = 64;
// Rows of a tile of the gram: as many accumulators as there are registers for.
constexpr int kTileRows = PLUMBLINE_PACK == 8 ? 4 : 2, kTileColumns = 4;

// Columns of one of the two Jacobian rows of all corners of a chunk: [f's coordinate, 1, distortion, dw dt,
// residual], zero columns up to a multiple of 4. The two rows share no focal length and no centre, so these
// columns are two fewer than the parameters.
template <class L>
struct Layout {
  static constexpr int kDistortion = L::kNumParams - 4, kColumns = 2 + kDistortion + 7;
  // One column more: residuals of a second state, for their products with this state's derivatives.
  static constexpr int kPadded = (kColumns + 1 + 3) / 4 * 4;
  static constexpr int kTiles = kPadded / kTileRows * (kPadded / kTileColumns);

  // Row of the gram that column `c` of the Jacobian row `axis` (0: u, 1: v) belongs to.
  static constexpr int row_of(int c, int axis) { return c == 0 ? axis : c == 1 ? 2 + axis : c + 2; }
};

template <class L>
struct Sums {
  Pack tiles[Layout<L>::kTiles][kTileRows * kTileColumns];
};

// gram += columns' columns over one chunk of one Jacobian row. Tiles wholly above the diagonal are left out.
template <class L>
inline __attribute__((always_inline)) void add_gram(const double* columns, int n, Sums<L>& sums) {
  constexpr int kPadded = Layout<L>::kPadded;
  for (int i = 0; i < kPadded; i += kTileRows) {
    for (int j = 0; j < kPadded && j < i + kTileRows; j += kTileColumns) {
      Pack* tile = sums.tiles[i / kTileRows * (kPadded / kTileColumns) + j / kTileColumns];
      Pack acc[kTileRows * kTileColumns];
      for (int k = 0; k < kTileRows * kTileColumns; ++k) acc[k] = tile[k];
      for (int p = 0; p < n; p += kWidth) {
        Pack a[kTileRows], b[kTileColumns];
        for (int r = 0; r < kTileRows; ++r) a[r] = load(columns + (i + r) * kChunk + p);
        for (int c = 0; c < kTileColumns; ++c) b[c] = load(columns + (j + c) * kChunk + p);
        for (int r = 0; r < kTileRows; ++r) {
          for (int c = 0; c < kTileColumns; ++c)
            acc[r * kTileColumns + c] = acc[r * kTileColumns + c] + a[r] * b[c];
        }
      }
      for (int k = 0; k < kTileRows * kTileColumns; ++k) tile[k] = acc[k];
    }
  }
}

template <class L>
inline __attribute__((always_inline)) void write_gram(const Sums<L>& sums, int axis, double* gram) {
  using Lay = Layout<L>;
  for (int i = 0; i < Lay::kColumns; ++i) {
    for (int j = 0; j <= i; ++j) {
      const Pack& p = sums.tiles[i / kTileRows * (Lay::kPadded / kTileColumns) + j / kTileColumns]
                                [i % kTileRows * kTileColumns + j % kTileColumns];
      double sum = 0;
      for (int w = 0; w < kWidth; ++w) sum += p.v[w];
      const int row = Lay::row_of(i, axis), column = Lay::row_of(j, axis);
      gram[row * (row + 1) / 2 + column] += sum;
    }
  }
}

// second[0 .. n_params + 5] += derivatives' products with the second state's residuals.
template <class L>
inline __attribute__((always_inline)) void write_second(const Sums<L>& sums, int axis, double* second) {
  using Lay = Layout<L>;
  constexpr int i = Lay::kColumns;
  for (int j = 0; j + 1 < Lay::kColumns; ++j) {
    const Pack& p = sums.tiles[i / kTileRows * (Lay::kPadded / kTileColumns) + j / kTileColumns]
                              [i % kTileRows * kTileColumns + j % kTileColumns];
    for (int w = 0; w < kWidth; ++w) second[Lay::row_of(j, axis)] += p.v[w];
  }
}

// A point of the board as a lens sees it, without derivatives.
template <class L>
inline __attribute__((always_inline)) void place(const L& lens, const double* R, const double* t, Pack X,
                                                 Pack Y, Pack Z, Pack* px) {
  lens.distort(R[0] * X + R[1] * Y + R[2] * Z + t[0], R[3] * X + R[4] * Y + R[5] * Z + t[1],
               R[6] * X + R[7] * Y + R[8] * Z + t[2], px, static_cast<Pack*>(nullptr),
               static_cast<Pack*>(nullptr));
  px[0] = lens.fx * px[0] + lens.cx;
  px[1] = lens.fy * px[1] + lens.cy;
}

// Factor of the residual and its derivatives, sqrt(rho'), and half of rho.
struct Weighing {
  Pack factor, half_rho;
};
inline __attribute__((always_inline)) Weighing weigh(int loss, double scale, Pack s) {
  if (loss == 1) {
    const Pack root = sqrt(s);
    const Mask beyond = root > spread(scale);
    return {select(beyond, sqrt(scale / root), spread(1.0)),
            select(beyond, scale * root - 0.5 * scale * scale, 0.5 * s)};
  }
  if (loss == 2) return {sqrt(1.0 / (1.0 + s / (scale * scale))), spread(0.0)};
  return {spread(1.0), 0.5 * s};
}

template <class L>
double run_kernel(const KernelInput& in, double* gram, double* s_out, double* second) {
  using Lay = Layout<L>;
  L lens;
  __builtin_memcpy(static_cast<void*>(&lens), in.k, sizeof lens);
  L other = lens;
  if (second) __builtin_memcpy(static_cast<void*>(&other), in.second_k, sizeof other);
  const double *R = in.R, *t = in.t, *columns = in.columns;
  const int n_padded = in.n_padded;
  alignas(64) double rows[2][Lay::kPadded * kChunk];
  Sums<L> sums[2];
  if (gram) {
    __builtin_memset(sums, 0, sizeof sums);
    for (auto& row : rows)
      __builtin_memset(row + Lay::kColumns * kChunk, 0,
                       sizeof(double) * kChunk * (Lay::kPadded - Lay::kColumns));
    for (int i = 0; i < (L::kNumParams + 7) * (L::kNumParams + 8) / 2; ++i) gram[i] = 0;
  }
  Pack cost = spread(0.0), farthest = spread(1.0);
  for (int first = 0; first < n_padded; first += kChunk) {
    const int n = n_padded - first < kChunk ? n_padded - first : kChunk;
    for (int p = 0; p < n; p += kWidth) {
      const double* at = columns + first + p;
      const Pack X = load(at), Y = load(at + n_padded), Z = load(at + 2 * n_padded);
      const Pack qx = R[0] * X + R[1] * Y + R[2] * Z, qy = R[3] * X + R[4] * Y + R[5] * Z,
                 qz = R[6] * X + R[7] * Y + R[8] * Z;
      Pack m[2], J_m_p[6], J_m_d[2 * Lay::kDistortion + 1];
      const Pack x = qx + t[0], y = qy + t[1], z = qz + t[2];
      const Pack side = select(z < spread(0.0), -z, z) * z / (x * x + y * y + z * z);
      farthest = select(side < farthest, side, farthest);
      lens.distort(x, y, z, m, gram ? J_m_p : nullptr, gram ? J_m_d : nullptr);
      const Pack weight = load(at + 5 * n_padded);
      const Pack r[2] = {weight * (lens.fx * m[0] + lens.cx - load(at + 3 * n_padded)),
                         weight * (lens.fy * m[1] + lens.cy - load(at + 4 * n_padded))};
      const Pack s = r[0] * r[0] + r[1] * r[1];
      const Weighing weighing = weigh(in.loss, in.loss_scale, s);
      cost = cost + weighing.half_rho;
      if (s_out) store(s_out + first + p, s);
      if (!gram) continue;
      const Pack w = weighing.factor * weight;
      for (int axis = 0; axis < 2; ++axis) {
        double* out = rows[axis] + p;
        const Pack f = w * (axis == 0 ? lens.fx : lens.fy);
        store(out, w * m[axis]);
        store(out + kChunk, w);
        for (int i = 0; i < Lay::kDistortion; ++i) store(out + (2 + i) * kChunk, f * J_m_d[2 * i + axis]);
        const Pack a = f * J_m_p[3 * axis], b = f * J_m_p[3 * axis + 1], c = f * J_m_p[3 * axis + 2];
        double* pose = out + (2 + Lay::kDistortion) * kChunk;  // q x [a b c] for dw, [a b c] for dt
        store(pose, qy * c - qz * b);
        store(pose + kChunk, qz * a - qx * c);
        store(pose + 2 * kChunk, qx * b - qy * a);
        store(pose + 3 * kChunk, a);
        store(pose + 4 * kChunk, b);
        store(pose + 5 * kChunk, c);
        store(pose + 6 * kChunk, weighing.factor * r[axis]);
      }
      if (!second) continue;
      Pack px[2];
      place(other, in.second_R, in.second_t, X, Y, Z, px);
      for (int axis = 0; axis < 2; ++axis)
        store(rows[axis] + Lay::kColumns * kChunk + p, w * (px[axis] - load(at + (3 + axis) * n_padded)));
    }
    if (!gram) continue;
    for (int axis = 0; axis < 2; ++axis) add_gram<L>(rows[axis], n, sums[axis]);
  }
  if (gram) {
    for (int axis = 0; axis < 2; ++axis) write_gram<L>(sums[axis], axis, gram);
  }
  if (second) {
    for (int i = 0; i < L::kNumParams + 6; ++i) second[i] = 0;
    for (int axis = 0; axis < 2; ++axis) write_second<L>(sums[axis], axis, second);
  }
  double total = 0;
  *in.farthest = 1;
  for (int w = 0; w < kWidth; ++w) {
    total += cost.v[w];
    if (farthest.v[w] < *in.farthest) *in.farthest = farthest.v[w];
  }
  return total;
}

// Lenses with a run-time number of parameters have no kernel (block_solver_can() says so).
template <class L>
constexpr KernelFunction kernel_of() {
  if constexpr (FixedLens<L>)
    return run_kernel<L>;
  else
    return nullptr;
}

template <class... L>
constexpr KernelSet kernels_of(const std::variant<L...>*, const char* name) {
  return {name, kWidth, {kernel_of<L>()...}};
}

}  // namespace
}  // namespace plumbline::detail
