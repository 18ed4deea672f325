// SPDX-License-Identifier: Apache-2.0
#pragma once
// The kernels themselves, for the view_kernel_*.cpp, each of which says PLUMBLINE_PACK (doubles at a time).
// Internal linkage on purpose: see view_kernel_sets.hpp.
#include "refine/spline_kernel_body.hpp"
#include "refine/view_kernel_pack.hpp"
#include "refine/view_kernel_sets.hpp"

namespace plumbline::detail {
namespace {

// Most corners whose Jacobian columns are held at once: both rows of them fit the first-level cache.
constexpr int kChunk = 80;
// Size of a tile of the gram: as many accumulators as there are registers for.
constexpr int kTileRows = PLUMBLINE_PACK == 8 ? 4 : 2, kTileColumns = 4;

// Columns of one of the two Jacobian rows of all corners of a chunk: [f's coordinate, 1, distortion, dw dt,
// residual]. The two rows share no focal length and no centre, so these columns are two fewer than the
// parameters.
template <class L>
struct Layout {
  static constexpr int kDistortion = L::kNumParams - 4, kColumns = 2 + kDistortion + 7;
  static constexpr int kSums = kColumns * (kColumns + 1) / 2;

  // Row of the gram that column `c` of the Jacobian row `axis` (0: u, 1: v) belongs to.
  static constexpr int row_of(int c, int axis) { return c == 0 ? axis : c == 1 ? 2 + axis : c + 2; }
};

constexpr int triangle(int i, int j) { return i * (i + 1) / 2 + j; }
constexpr int least(int a, int b) { return a < b ? a : b; }

// sums += the products of columns [I, I + kTileRows) with columns [J, J + kTileColumns) over n corners, as
// far as they are in the lower triangle of kColumns columns.
template <int kColumns, int I, int J>
inline __attribute__((always_inline)) void add_tile(const double* columns, int n, Pack* sums) {
  constexpr int kRows = least(kTileRows, kColumns - I), kWide = least(kTileColumns, I + kRows - J);
  Pack acc[kRows * kWide];
#pragma GCC unroll 16
  for (int k = 0; k < kRows * kWide; ++k) acc[k] = spread(0.0);
  for (int p = 0; p < n; p += kWidth) {
    Pack a[kRows], b[kWide];
#pragma GCC unroll 4
    for (int r = 0; r < kRows; ++r) a[r] = load(columns + (I + r) * kChunk + p);
#pragma GCC unroll 4
    for (int c = 0; c < kWide; ++c) b[c] = load(columns + (J + c) * kChunk + p);
#pragma GCC unroll 4
    for (int r = 0; r < kRows; ++r) {
#pragma GCC unroll 4
      for (int c = 0; c < kWide; ++c) {
        if (J + c <= I + r) acc[r * kWide + c] = acc[r * kWide + c] + a[r] * b[c];
      }
    }
  }
#pragma GCC unroll 4
  for (int r = 0; r < kRows; ++r) {
#pragma GCC unroll 4
    for (int c = 0; c < kWide; ++c) {
      Pack& into = sums[triangle(I + r, J + c)];
      if (J + c <= I + r) into = into + acc[r * kWide + c];
    }
  }
}

template <int kColumns, int I, int J>
inline __attribute__((always_inline)) void add_tiles(const double* columns, int n, Pack* sums) {
  add_tile<kColumns, I, J>(columns, n, sums);
  if constexpr (J + kTileColumns < least(I + kTileRows, kColumns)) {
    add_tiles<kColumns, I, J + kTileColumns>(columns, n, sums);
  } else if constexpr (I + kTileRows < kColumns) {
    add_tiles<kColumns, I + kTileRows, 0>(columns, n, sums);
  }
}

template <class L>
inline __attribute__((always_inline)) void write_gram(const Pack (&sums)[2][Layout<L>::kSums], double* gram) {
  using Lay = Layout<L>;
  for (int i = 0; i < triangle(L::kNumParams + 7, 0); ++i) gram[i] = 0;
  for (int i = 0; i < Lay::kColumns; ++i) {
    for (int j = 0; j <= i; ++j) {
      const Pack &u = sums[0][triangle(i, j)], &v = sums[1][triangle(i, j)];
      if (j >= 2) {
        gram[triangle(i + 2, j + 2)] = sum(u + v);
        continue;
      }
      gram[triangle(Lay::row_of(i, 0), Lay::row_of(j, 0))] = sum(u);
      gram[triangle(Lay::row_of(i, 1), Lay::row_of(j, 1))] = sum(v);
    }
  }
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

// A state held in registers.
template <class L>
struct Placed {
  L lens;
  double R[9], t[3];
  explicit __attribute__((always_inline)) Placed(const KernelState& at) {
    __builtin_memcpy(static_cast<void*>(&lens), at.k, sizeof lens);
    __builtin_memcpy(R, at.R, sizeof R);
    __builtin_memcpy(t, at.t, sizeof t);
  }
};

// Where the corner is farthest from the axis: the least z |z| / |p|^2, compared without a division.
struct Farthest {
  Pack z = spread(1.0), nn = spread(1.0);
  inline __attribute__((always_inline)) void see(Pack x, Pack y, Pack depth) {
    const Pack side = select(depth < spread(0.0), -depth, depth) * depth;
    const Pack square = x * x + y * y + depth * depth;
    const Mask farther = side * nn < z * square;
    z = select(farther, side, z);
    nn = select(farther, square, nn);
  }
  inline __attribute__((always_inline)) void answer(KernelAnswer& out) const {
    out.far_z = out.far_nn = 1;
    for (int w = 0; w < kWidth; ++w) {
      if (z.v[w] * out.far_nn < out.far_z * nn.v[w]) out.far_z = z.v[w], out.far_nn = nn.v[w];
    }
  }
};

// products[axis][c] += column c's products with the second state's weighted residuals.
template <class L>
inline __attribute__((always_inline)) void add_second(const Placed<L>& second, const KernelInput& in,
                                                      int first, int n,
                                                      const double (&rows)[2][Layout<L>::kColumns * kChunk],
                                                      Pack (&products)[2][Layout<L>::kColumns]) {
  const double *R = second.R, *t = second.t;
  for (int p = 0; p < n; p += kWidth) {
    const double* at = in.points + first + p;
    const Pack X = load(at), Y = load(at + in.n_padded), Z = load(at + 2 * in.n_padded);
    Pack m[2];
    second.lens.distort(R[0] * X + R[1] * Y + R[2] * Z + t[0], R[3] * X + R[4] * Y + R[5] * Z + t[1],
                        R[6] * X + R[7] * Y + R[8] * Z + t[2], m, static_cast<Pack*>(nullptr),
                        static_cast<Pack*>(nullptr));
    const Pack r[2] = {second.lens.fx * m[0] + second.lens.cx - load(in.px + first + p),
                       second.lens.fy * m[1] + second.lens.cy - load(in.px + in.n_padded + first + p)};
    for (int axis = 0; axis < 2; ++axis) {
      const Pack w = load(rows[axis] + kChunk + p);  // the column of ones holds the weights
      for (int c = 0; c + 1 < Layout<L>::kColumns; ++c)
        products[axis][c] = products[axis][c] + load(rows[axis] + c * kChunk + p) * (w * r[axis]);
    }
  }
}

template <class L>
inline __attribute__((always_inline)) void write_second(const Pack (&products)[2][Layout<L>::kColumns],
                                                        double* second) {
  for (int i = 0; i < L::kNumParams + 6; ++i) second[i] = 0;
  for (int axis = 0; axis < 2; ++axis) {
    for (int c = 0; c + 1 < Layout<L>::kColumns; ++c)
      second[Layout<L>::row_of(c, axis)] += sum(products[axis][c]);
  }
}

template <class L>
KernelAnswer run_kernel(const KernelInput& in, double* gram, double* s_out, double* second) {
  using Lay = Layout<L>;
  const Placed<L> here(in.at), other(second ? in.second : in.at);
  const L& lens = here.lens;
  const double *R = here.R, *t = here.t;
  const int n_padded = in.n_padded, n_chunks = (n_padded + kChunk - 1) / kChunk;
  const int size = ((n_padded + n_chunks - 1) / n_chunks + 7) / 8 * 8;
  alignas(64) double rows[2][Lay::kColumns * kChunk];
  alignas(64) Pack sums[2][Lay::kSums];
  Pack products[2][Lay::kColumns];
  if (gram) __builtin_memset(static_cast<void*>(sums), 0, sizeof sums);
  if (second) __builtin_memset(static_cast<void*>(products), 0, sizeof products);
  Pack cost = spread(0.0);
  Farthest farthest;
  for (int first = 0; first < n_padded; first += size) {
    const int n = least(n_padded - first, size);
    for (int p = 0; p < n; p += kWidth) {
      const double *at = in.points + first + p, *px = in.px + first + p;
      const Pack X = load(at), Y = load(at + n_padded), Z = load(at + 2 * n_padded);
      const Pack weight = load(at + 3 * n_padded);
      const Pack qx = R[0] * X + R[1] * Y + R[2] * Z, qy = R[3] * X + R[4] * Y + R[5] * Z,
                 qz = R[6] * X + R[7] * Y + R[8] * Z;
      Pack m[2], J_m_p[6], J_m_d[2 * Lay::kDistortion + 1];
      const Pack x = qx + t[0], y = qy + t[1], z = qz + t[2];
      farthest.see(x, y, z);
      lens.distort(x, y, z, m, gram ? J_m_p : nullptr, gram ? J_m_d : nullptr);
      const Pack r[2] = {weight * (lens.fx * m[0] + lens.cx - load(px)),
                         weight * (lens.fy * m[1] + lens.cy - load(px + n_padded))};
      const Pack s = r[0] * r[0] + r[1] * r[1];
      const Weighing weighing = weigh(in.loss, in.loss_scale, s);
      cost = cost + weighing.half_rho;
      if (s_out) store(s_out + first + p, s);
      if (!gram) continue;
      const Pack w = weighing.factor * weight;
#pragma GCC unroll 2
      for (int axis = 0; axis < 2; ++axis) {
        double* out = rows[axis] + p;
        const Pack f = w * (axis == 0 ? lens.fx : lens.fy);
        store(out, w * m[axis]);
        store(out + kChunk, w);
#pragma GCC unroll 16
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
    }
    if (!gram) continue;
    for (int axis = 0; axis < 2; ++axis) add_tiles<Lay::kColumns, 0, 0>(rows[axis], n, sums[axis]);
    if (second) add_second<L>(other, in, first, n, rows, products);
  }
  if (gram) write_gram<L>(sums, gram);
  if (second) write_second<L>(products, second);
  KernelAnswer answer{sum(cost), 1, 1};
  farthest.answer(answer);
  return answer;
}

inline bool factor6(double* A) {
  for (int j = 0; j < 6; ++j) {
    double d = A[7 * j];
    for (int k = 0; k < j; ++k) d -= A[6 * k + j] * A[6 * k + j];
    if (!(d > 0 && d < __builtin_inf())) return false;
    const double root = __builtin_sqrt(d), inverse = 1 / root;
    A[7 * j] = root;
    for (int i = j + 1; i < 6; ++i) {
      double e = A[6 * j + i];
      for (int k = 0; k < j; ++k) e -= A[6 * k + i] * A[6 * k + j];
      A[6 * j + i] = e * inverse;
    }
  }
  return true;
}

bool run_eliminate(double* A, double* B, int rows) {
  if (!factor6(A)) return false;
  for (int j = 0; j < 6; ++j) {
    double* __restrict column = B + j * rows;
    for (int k = 0; k < j; ++k) {
      const double *other = B + k * rows, l = A[6 * k + j];
      for (int i = 0; i < rows; ++i) column[i] -= l * other[i];
    }
    const double inverse = 1 / A[7 * j];
    for (int i = 0; i < rows; ++i) column[i] *= inverse;
  }
  return true;
}

void run_add_outer(const double* B, int rows, const Segment* segments, int n_segments, double* S, int S_rows,
                   int first, int end) {
  const double *b0 = B, *b1 = B + rows, *b2 = B + 2 * rows, *b3 = B + 3 * rows, *b4 = B + 4 * rows,
               *b5 = B + 5 * rows;
  int c = 0;  // row of B that makes the column
  for (int s = 0; s < n_segments && segments[s].first < end; ++s) {
    for (int e = 0; e < segments[s].n; ++e, ++c) {
      if (segments[s].first + e < first || segments[s].first + e >= end) continue;
      const double x0 = b0[c], x1 = b1[c], x2 = b2[c], x3 = b3[c], x4 = b4[c], x5 = b5[c];
      double* column = S + static_cast<long>(segments[s].first + e) * S_rows;
      int r = c - e;
      for (int q = s; q < n_segments; ++q) {
        double* __restrict out = column + segments[q].first;
        const int n = segments[q].n;
        for (int i = q == s ? e : 0; i < n; ++i)
          out[i] += (x0 * b0[r + i] + x1 * b1[r + i]) + (x2 * b2[r + i] + x3 * b3[r + i]) +
                    (x4 * b4[r + i] + x5 * b5[r + i]);
        r += n;
      }
    }
  }
}

// Lenses with a run-time number of parameters have another kernel (run_spline).
template <class L>
constexpr KernelFunction kernel_of() {
  if constexpr (FixedLens<L>)
    return run_kernel<L>;
  else
    return nullptr;
}

template <class... L>
constexpr KernelSet kernels_of(const std::variant<L...>*, const char* name) {
  return {name, kWidth, run_eliminate, run_add_outer, run_spline, {kernel_of<L>()...}};
}

}  // namespace
}  // namespace plumbline::detail
