// SPDX-License-Identifier: Apache-2.0
#include "plumbline/lens/polynomial.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "plumbline/core/random.hpp"

namespace plumbline::detail {
namespace {

template <std::size_t N>
double value(const std::array<double, N>& c, double s) {
  double v = 0;
  for (std::size_t i = N; i-- > 0;) v = v * s + c[i];
  return v;
}

template <std::size_t N>
double size_of(const std::array<double, N>& c, double s_max) {
  double size = 0, power = 1;
  for (double v : c) size += std::abs(v) * power, power *= s_max;
  return size;
}

// Dense sampling decides most random polynomials beyond doubt; those whose smallest sample lies within what
// the sampling may have missed are left out, and must be few.
template <std::size_t N>
void compare_with_sampling(std::uint64_t seed) {
  Rng rng(seed);
  int positive = 0, negative = 0, undecided = 0;
  const int n_samples = 4000;
  for (int i = 0; i < 3000; ++i) {
    std::array<double, N> c;
    const double s_max = std::pow(10, rng.uniform(-2, 1));
    for (double& v : c) v = rng.normal();
    // Centre the roots of many of them in the interval and their smallest value near zero.
    for (std::size_t j = 0; j < N; ++j) c[j] /= std::pow(s_max, double(j));
    if (i % 3 > 0) c[0] = std::abs(c[0]);
    double smallest = value(c, s_max);
    for (int k = 0; k <= n_samples; ++k) smallest = std::min(smallest, value(c, s_max * k / n_samples));
    if (i % 3 == 2) {  // touch zero almost: smallest value + or - 1e-4 of its size
      c[0] += (rng.index(2) == 0 ? 1e-4 : -1e-4) * size_of(c, s_max) - smallest;
      smallest = value(c, 0);
      for (int k = 0; k <= n_samples; ++k) smallest = std::min(smallest, value(c, s_max * k / n_samples));
    }
    // Between two samples a polynomial of this degree dips by no more than (h^2 / 8) max|p''|.
    const double missed = std::pow(1.0 / n_samples, 2) / 8 * std::pow(double(N), 2) * size_of(c, s_max);
    if (smallest <= 0) {
      EXPECT_FALSE(positive_on(c, s_max)) << i;
      ++negative;
    } else if (smallest > missed + 1e-8 * size_of(c, s_max)) {
      EXPECT_TRUE(positive_on(c, s_max)) << i;
      ++positive;
    } else {
      ++undecided;
    }
  }
  EXPECT_GT(positive, 500);
  EXPECT_GT(negative, 500);
  EXPECT_LT(undecided, 30);
}

TEST(PositiveOn, AgreesWithDenseSampling) {
  compare_with_sampling<2>(1);
  compare_with_sampling<4>(2);
  compare_with_sampling<5>(3);
  compare_with_sampling<7>(4);
}

TEST(PositiveOn, SeesADoubleRootAndADipBelowZero) {
  // (s - 1)^2 + gap on [0, 3]
  const auto dip = [](double gap) { return std::array<double, 3>{1 + gap, -2, 1}; };
  EXPECT_FALSE(positive_on(dip(0), 3));
  EXPECT_FALSE(positive_on(dip(-1e-12), 3));
  EXPECT_TRUE(positive_on(dip(1e-7), 3));
  EXPECT_TRUE(positive_on(dip(0), 0.99));  // the root is outside
  EXPECT_FALSE(positive_on(dip(0), 1));
}

TEST(PositiveOn, AnEmptyIntervalIsTheConstantTerm) {
  EXPECT_TRUE(positive_on(std::array<double, 3>{1e-9, -5, -5}, 0));
  EXPECT_FALSE(positive_on(std::array<double, 3>{0, 5, 5}, 0));
  EXPECT_FALSE(positive_on(std::array<double, 3>{0, 5, 5}, 1));  // zero at the left end
  EXPECT_FALSE(positive_on(std::array<double, 3>{-1, 500, 500}, 1));
}

TEST(PositiveOn, NotANumberIsNotPositive) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < 4; ++i) {
    std::array<double, 4> c{1, 2, 3, 4};
    c[i] = nan;
    EXPECT_FALSE(positive_on(c, 1)) << i;
  }
  EXPECT_FALSE(positive_on(std::array<double, 2>{1, 1}, nan));
}

// The first positive coefficients settle it; this is the case that a lens meets for nearly every point.
TEST(PositiveOn, CoefficientsWithoutASignChange) {
  EXPECT_TRUE(positive_on(std::array<double, 4>{1, 2, 3, 4}, 1e6));
  EXPECT_TRUE(positive_on(std::array<double, 4>{1, -0.1, -0.1, -0.1}, 1));
  EXPECT_FALSE(positive_on(std::array<double, 4>{1, -0.5, -0.5, -0.5}, 1));
}

}  // namespace
}  // namespace plumbline::detail
