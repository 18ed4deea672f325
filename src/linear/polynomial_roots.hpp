// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <array>
#include <cmath>

/// Real roots of polynomials of fixed degree, without the heap. Private to the module.
namespace plumbline::detail {

/// Coefficients in ascending order: p[0] + p[1] x + ... + p[N] x^N.
template <int N>
using Polynomial = std::array<double, N + 1>;

/// The root of a polynomial of degree d in (a, b), between whose ends its sign changes once: Newton's method,
/// with bisection where a step would leave the bracket.
inline double root_in_bracket(const double* p, int d, double a, double b, double value_at_a) {
  // Roots are polished by their users, so the last digits are not worth a step.
  constexpr double kTolerance = 1e-12;
  double x = 0.5 * (a + b);
  for (int i = 0; i < 60; ++i) {
    double value = p[d], slope = 0;
    for (int k = d - 1; k >= 0; --k) {
      slope = slope * x + value;
      value = value * x + p[k];
    }
    if (value == 0) return x;
    ((value < 0) == (value_at_a < 0) ? a : b) = x;
    double next = x - value / slope;
    if (!(next > a && next < b)) next = 0.5 * (a + b);
    const double step = std::abs(next - x);
    x = next;
    if (step <= kTolerance) break;
  }
  return x;
}

/// The real roots in [-1, 1], ascending; the number of them. Between two neighbouring roots of its derivative
/// a polynomial is monotone, so the roots of the highest derivatives bracket those of the next ones (Yuksel
/// 2022, "High-performance polynomial root finding for graphics"). A double root that rounding has lifted off
/// the axis counts once.
template <int N>
int roots_in_unit_interval(const Polynomial<N>& p, std::array<double, N>& roots) {
  double c[N + 1][N + 1];  // c[d]: the derivative of degree d
  for (int i = 0; i <= N; ++i) c[N][i] = p[static_cast<std::size_t>(i)];
  for (int d = N; d > 1; --d) {
    for (int i = 0; i < d; ++i) c[d - 1][i] = (i + 1) * c[d][i + 1];
  }
  const auto value_at = [&](int d, double x) {
    double value = c[d][d];
    for (int k = d - 1; k >= 0; --k) value = value * x + c[d][k];
    return value;
  };
  double size = 0;
  for (double k : p) size += std::abs(k);
  const double zero = 1e-14 * size;  // what rounding leaves of a value in [-1, 1]
  std::array<double, N + 2> cuts{-1, 1};
  int n_cuts = 2, n = 0;
  for (int d = 1; d <= N; ++d) {
    n = 0;
    double left = value_at(d, cuts[0]);
    for (int i = 1; i < n_cuts; ++i) {
      const double right = value_at(d, cuts[static_cast<std::size_t>(i)]);
      const double a = cuts[static_cast<std::size_t>(i - 1)], b = cuts[static_cast<std::size_t>(i)];
      if ((left < 0) != (right < 0) && n < N) {
        roots[static_cast<std::size_t>(n++)] = root_in_bracket(c[d], d, a, b, left);
      } else if (d == N && std::abs(right) <= zero && i + 1 < n_cuts && n < N) {
        const double after = value_at(d, cuts[static_cast<std::size_t>(i + 1)]);
        if ((after < 0) == (right < 0)) roots[static_cast<std::size_t>(n++)] = b;
      }
      left = right;
    }
    if (d == N) break;
    for (int i = 0; i < n; ++i) cuts[static_cast<std::size_t>(i + 1)] = roots[static_cast<std::size_t>(i)];
    cuts[static_cast<std::size_t>(n + 1)] = 1;
    n_cuts = n + 2;
  }
  return n;
}

/// Calls visit(x, y) for each real root x : y of the homogeneous polynomial sum p[k] x^k y^(N-k), with
/// max(|x|, |y|) = 1: roots that are large, or at infinity, are found as safely as small ones.
template <int N, class Visit>
void visit_projective_roots(const Polynomial<N>& p, Visit&& visit) {
  std::array<double, N> roots;
  const int n_small = roots_in_unit_interval<N>(p, roots);
  for (int i = 0; i < n_small; ++i) visit(roots[static_cast<std::size_t>(i)], 1.0);
  Polynomial<N> reversed = p;
  std::reverse(reversed.begin(), reversed.end());
  const int n_large = roots_in_unit_interval<N>(reversed, roots);
  for (int i = 0; i < n_large; ++i) visit(1.0, roots[static_cast<std::size_t>(i)]);
}

}  // namespace plumbline::detail
