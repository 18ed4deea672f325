// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cmath>
#include <cstddef>

/// Private to the module.
namespace plumbline::detail {

/// c[0] + c[1] x + ... + c[N - 1] x^(N - 1).
template <std::size_t N>
double polynomial(const std::array<double, N>& c, double x) {
  double sum = 0;
  for (std::size_t i = N; i-- > 0;) sum = sum * x + c[i];
  return sum;
}

/// The real roots in [-1, 1], ascending: between two neighbours among the ends and the roots of the
/// derivative a polynomial is monotonic, so a change of sign encloses one root, which Newton's method with
/// bisection as its guard finds to rounding. A root that touches zero without crossing may be missed.
/// \returns how many of `roots` are set
template <std::size_t N>
int roots_in_unit_interval(const std::array<double, N>& c, std::array<double, N - 1>& roots) {
  if constexpr (N <= 1) {
    return 0;
  } else {
    std::array<double, N - 1> slope;
    for (std::size_t i = 1; i < N; ++i) slope[i - 1] = static_cast<double>(i) * c[i];
    std::array<double, N> ends;  // -1, the extrema, 1
    int n_ends = 0, n = 0;
    ends[n_ends++] = -1;
    if constexpr (N > 2) {
      std::array<double, N - 2> extrema;
      const int n_extrema = roots_in_unit_interval(slope, extrema);
      for (int i = 0; i < n_extrema; ++i) ends[n_ends++] = extrema[i];
    }
    ends[n_ends++] = 1;
    for (int i = 0; i + 1 < n_ends; ++i) {
      double low = ends[i], high = ends[i + 1];
      const double at_low = polynomial(c, low), at_high = polynomial(c, high);
      if (at_low == 0) {  // an end that is a root belongs to the interval on its right
        if (n == 0 || roots[n - 1] != low) roots[n++] = low;
        continue;
      }
      if (!((at_low < 0) != (at_high < 0)) && at_high != 0) continue;
      double x = 0.5 * (low + high);
      for (int k = 0; k < 100; ++k) {
        const double value = polynomial(c, x);
        if (value == 0) break;
        ((value < 0) == (at_low < 0) ? low : high) = x;
        double next = x - value / polynomial(slope, x);
        if (!(next > low && next < high)) next = 0.5 * (low + high);
        if (next == x || std::abs(next - x) < 1e-16 * std::abs(x)) break;
        x = next;
      }
      if (n < static_cast<int>(N) - 1) roots[n++] = x;
    }
    return n;
  }
}

}  // namespace plumbline::detail
