// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstddef>

namespace plumbline::detail {

/// Whether a polynomial with Bernstein coefficients b on an interval is positive on all of it: it lies in
/// their convex hull and takes the first and the last as its values at the ends; halving where they do not
/// decide.
template <std::size_t N>
bool bernstein_positive(const std::array<double, N>& b, int depth) {
  if (!(b[0] > 0) || !(b[N - 1] > 0)) return false;
  bool all_positive = true;
  for (double v : b) all_positive = all_positive && v > 0;
  if (all_positive) return true;
  if (depth == 0) return false;
  std::array<double, N> left{}, right = b;  // de Casteljau at the middle
  for (std::size_t k = 0; k < N; ++k) {
    left[k] = right[0];
    for (std::size_t i = 0; i + k + 1 < N; ++i) right[i] = 0.5 * (right[i] + right[i + 1]);
  }
  return bernstein_positive(left, depth - 1) && bernstein_positive(right, depth - 1);
}

/// 1 / C(n, j) for j = 0..n.
template <std::size_t N>
constexpr std::array<double, N> inverse_binomials() {
  std::array<double, N> inverse{};
  double choose = 1;
  for (std::size_t j = 0; j < N; ++j) {
    inverse[j] = 1 / choose;
    choose = choose * static_cast<double>(N - 1 - j) / static_cast<double>(j + 1);
  }
  return inverse;
}

/// Whether the polynomial with coefficients c (c[0] + c[1] s + ...) is positive everywhere on [0, s_max],
/// s_max >= 0. For most points of a mild lens the negative terms at s_max, taken together, are smaller than
/// c[0], and that settles it; otherwise the Bernstein coefficients do (Farouki, "The Bernstein polynomial
/// basis: a centennial retrospective", 2012). A polynomial that touches zero to within rounding may be judged
/// either way; one with a NaN is not positive.
template <std::size_t N>
bool positive_on(const std::array<double, N>& c, double s_max) {
  static constexpr std::array<double, N> kInverse = inverse_binomials<N>();
  std::array<double, N> b;
  double power = 1, low = 0, sum = 0;
  for (std::size_t j = 0; j < N; ++j, power *= s_max) {
    b[j] = c[j] * power;
    low += j > 0 && b[j] > 0 ? 0.0 : b[j];
    sum += b[j];
  }
  if (low > 0) return true;
  if (!(c[0] > 0) || !(sum > 0)) return false;  // the values at the ends
  // b_i = sum over j <= i of C(i, j) / C(degree, j) c_j s_max^j, the sums by Pascal's rule.
  for (std::size_t j = 0; j < N; ++j) b[j] *= kInverse[j];
  for (std::size_t k = 1; k < N; ++k) {
    for (std::size_t i = N - 1; i >= k; --i) b[i] += b[i - 1];
  }
  return bernstein_positive(b, 32);
}

}  // namespace plumbline::detail
