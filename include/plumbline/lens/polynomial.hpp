// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstddef>

namespace plumbline::detail {

/// Whether the polynomial with coefficients c (c[0] + c[1] s + ...) is positive everywhere on [0, s_max].
/// Decided by its Bernstein coefficients on the interval (a polynomial lies in their convex hull) and halving
/// the interval where they do not decide; Farouki, "The Bernstein polynomial basis: a centennial
/// retrospective" (2012). A polynomial that touches zero to within about 1e-9 of its size counts as not
/// positive.
template <std::size_t N>
bool positive_on(const std::array<double, N>& c, double s_max) {
  constexpr int degree = static_cast<int>(N) - 1;
  // Bernstein coefficients on [0, s_max]: b_i = sum_{j <= i} C(i, j) / C(degree, j) c_j s_max^j.
  std::array<double, N> b{};
  double power = 1, choose_degree = 1;  // s_max^j, C(degree, j)
  for (int j = 0; j <= degree; ++j) {
    const double scaled = c[j] * power / choose_degree;
    double choose = 1;  // C(i, j)
    for (int i = j; i <= degree; ++i) {
      b[i] += choose * scaled;
      choose = choose * (i + 1) / (i + 1 - j);
    }
    power *= s_max;
    choose_degree = choose_degree * (degree - j) / (j + 1);
  }
  const auto decide = [](auto&& self, const std::array<double, N>& q, int depth) -> bool {
    if (!(q[0] > 0) || !(q[degree] > 0)) return false;  // the ends are values of the polynomial
    bool all_positive = true;
    for (double v : q) all_positive = all_positive && v > 0;
    if (all_positive) return true;
    if (depth == 0) return false;
    std::array<double, N> left{}, right = q;  // de Casteljau at the middle
    for (int k = 0; k <= degree; ++k) {
      left[k] = right[0];
      for (int i = 0; i < degree - k; ++i) right[i] = 0.5 * (right[i] + right[i + 1]);
    }
    return self(self, left, depth - 1) && self(self, right, depth - 1);
  };
  return decide(decide, b, 15);
}

}  // namespace plumbline::detail
