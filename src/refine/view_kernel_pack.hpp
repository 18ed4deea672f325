// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cmath>
#include <cstring>

/// A pack of PLUMBLINE_PACK doubles with the arithmetic that lenses need, on the compiler's vector types.
/// Everything has internal linkage (see view_kernel_sets.hpp).
namespace plumbline::detail {
namespace {

constexpr int kWidth = PLUMBLINE_PACK;
typedef double VectorOfDoubles __attribute__((vector_size(sizeof(double) * PLUMBLINE_PACK)));
typedef long long VectorOfInts __attribute__((vector_size(sizeof(double) * PLUMBLINE_PACK)));

struct Pack {
  VectorOfDoubles v;
};

#define PLUMBLINE_INLINE inline __attribute__((always_inline))
PLUMBLINE_INLINE Pack spread(double a) { return {VectorOfDoubles{} + a}; }
PLUMBLINE_INLINE Pack load(const double* p) {
  Pack a;
  __builtin_memcpy(&a.v, p, sizeof a.v);
  return a;
}
PLUMBLINE_INLINE void store(double* p, Pack a) { __builtin_memcpy(p, &a.v, sizeof a.v); }
PLUMBLINE_INLINE Pack operator+(Pack a, Pack b) { return {a.v + b.v}; }
PLUMBLINE_INLINE Pack operator-(Pack a, Pack b) { return {a.v - b.v}; }
PLUMBLINE_INLINE Pack operator*(Pack a, Pack b) { return {a.v * b.v}; }
PLUMBLINE_INLINE Pack operator/(Pack a, Pack b) { return {a.v / b.v}; }
PLUMBLINE_INLINE Pack operator-(Pack a) { return {-a.v}; }
PLUMBLINE_INLINE Pack operator+(double a, Pack b) { return {a + b.v}; }
PLUMBLINE_INLINE Pack operator-(double a, Pack b) { return {a - b.v}; }
PLUMBLINE_INLINE Pack operator*(double a, Pack b) { return {a * b.v}; }
PLUMBLINE_INLINE Pack operator/(double a, Pack b) { return {a / b.v}; }
PLUMBLINE_INLINE Pack operator+(Pack a, double b) { return {a.v + b}; }
PLUMBLINE_INLINE Pack operator-(Pack a, double b) { return {a.v - b}; }
PLUMBLINE_INLINE Pack operator*(Pack a, double b) { return {a.v * b}; }
PLUMBLINE_INLINE Pack operator/(Pack a, double b) { return {a.v / b}; }

struct Mask {
  VectorOfInts m;
};
PLUMBLINE_INLINE Mask operator<(Pack a, Pack b) { return {a.v < b.v}; }
PLUMBLINE_INLINE Mask operator>(Pack a, Pack b) { return {a.v > b.v}; }
PLUMBLINE_INLINE Pack select(Mask c, Pack a, Pack b) { return {c.m ? a.v : b.v}; }

/// The sum of all, in halves: a chain of additions would wait for each other.
PLUMBLINE_INLINE double sum(Pack a) {
  double x[PLUMBLINE_PACK];
  typedef double Half
      __attribute__((vector_size(sizeof(double) * (PLUMBLINE_PACK > 2 ? PLUMBLINE_PACK / 2 : 2))));
  if constexpr (PLUMBLINE_PACK > 2) {
    Half low, high;
    __builtin_memcpy(&low, &a.v, sizeof low);
    __builtin_memcpy(&high, reinterpret_cast<const char*>(&a.v) + sizeof low, sizeof high);
    low += high;
    __builtin_memcpy(x, &low, sizeof low);
    return PLUMBLINE_PACK == 8 ? (x[0] + x[2 % PLUMBLINE_PACK]) + (x[1] + x[3 % PLUMBLINE_PACK])
                               : x[0] + x[1];
  }
  __builtin_memcpy(x, &a.v, sizeof x);
  return x[0] + x[1];
}

PLUMBLINE_INLINE Pack sqrt(Pack a) {
  Pack r;
  for (int i = 0; i < kWidth; ++i) r.v[i] = __builtin_sqrt(a.v[i]);
  return r;
}

/// atan of x in [0, infinity]: turned by pi/2 or pi/4 so that |y| <= tan(pi/8), where atan(y)/y is a
/// polynomial of degree 11 in y^2 to 1.3e-18 (interpolation at Chebyshev's points of [0, tan(pi/8)^2] in
/// 60-digit arithmetic).
PLUMBLINE_INLINE Pack atan_positive(Pack x) {
  constexpr double kTan8 = 0.41421356237309503, kTan38 = 2.4142135623730951;
  constexpr double kQuarter = 0.78539816339744831,
                   kQuarterRest = 3.0616169978683830e-17;  // pi/4, as two doubles
  constexpr double c[] = {-0.017805397205419446, 0.03796525745386593,  -0.05035102456601552,
                          0.05846878297330872,   -0.06662951813629191, 0.07692045330902225,
                          -0.09090896809064027,  0.11111110744919658,  -0.14285714279250245,
                          0.19999999999940893,   -0.3333333333333312};
  const Pack zero = spread(0.0);
  const Mask large = x > spread(kTan38), middle = x > spread(kTan8);
  const Pack y = select(large, -(1.0 / x), select(middle, (x - 1.0) / (x + 1.0), x));
  const Pack base = select(large, spread(2 * kQuarter), select(middle, spread(kQuarter), zero));
  const Pack rest = select(large, spread(2 * kQuarterRest), select(middle, spread(kQuarterRest), zero));
  const Pack z = y * y;
  Pack p = spread(c[0]);
  for (int i = 1; i < 11; ++i) p = p * z + c[i];
  return base + (y + (y * (z * p) + rest));
}

/// Angle in [0, pi) of the point (z, r), r >= 0.
PLUMBLINE_INLINE Pack atan2(Pack r, Pack z) {
  const Pack n = sqrt(r * r + z * z);
  // Of the two forms of tan(angle / 2) the one that does not cancel.
  const Mask behind = z < spread(0.0);
  return 2.0 * atan_positive(select(behind, n - z, r) / select(behind, r, n + z));
}
#undef PLUMBLINE_INLINE

}  // namespace
}  // namespace plumbline::detail
