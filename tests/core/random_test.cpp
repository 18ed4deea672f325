// SPDX-License-Identifier: Apache-2.0
#include "plumbline/core/random.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>
#include <vector>

namespace plumbline {
namespace {

// The test values that are published with splitmix64 for the seed 1234567.
TEST(Rng, BitsAreThoseOfSplitmix64) {
  Rng rng(1234567);
  for (std::uint64_t expected : {6457827717110365317ULL, 3203168211198807973ULL, 9817491932198370423ULL,
                                 4593380528125082431ULL, 16408922859458223821ULL}) {
    EXPECT_EQ(rng.bits(), expected);
  }
}

TEST(Rng, SameSeedSameNumbersOtherSeedOthers) {
  Rng a(5), b(5), c(6);
  bool differs = false;
  for (int i = 0; i < 100; ++i) {
    const double x = a.normal();
    EXPECT_EQ(x, b.normal());
    differs = differs || x != c.normal();
  }
  EXPECT_TRUE(differs);
}

// Bounds of 5 standard errors on n = 200000 samples.
TEST(Rng, UniformHasItsMomentsAndKeepsItsBounds) {
  Rng rng(7);
  const int n = 200000;
  double sum = 0, sum2 = 0;
  for (int i = 0; i < n; ++i) {
    const double x = rng.uniform(-1, 3);
    ASSERT_GE(x, -1);
    ASSERT_LT(x, 3);
    sum += x;
    sum2 += x * x;
  }
  const double mean = sum / n, variance = sum2 / n - mean * mean, sigma = 4 / std::sqrt(12.0);
  EXPECT_NEAR(mean, 1.0, 5 * sigma / std::sqrt(n));
  // The variance of (x - mean)^2 of a uniform variable is sigma^4 (9/5 - 1).
  EXPECT_NEAR(variance, sigma * sigma, 5 * sigma * sigma * std::sqrt(0.8 / n));
}

TEST(Rng, UniformStaysBelowItsUpperEndWhereRoundingWouldReachIt) {
  Rng rng(8);
  const double low = 1.0, high = std::nextafter(1.0, 2.0);  // no double between them
  for (int i = 0; i < 1000; ++i) ASSERT_EQ(rng.uniform(low, high), low);
}

TEST(Rng, NormalHasItsMoments) {
  Rng rng(9);
  const int n = 200000;
  double m1 = 0, m2 = 0, m3 = 0, m4 = 0;
  int within_one = 0;
  for (int i = 0; i < n; ++i) {
    const double x = rng.normal(2.0) / 2.0;
    m1 += x / n;
    m2 += x * x / n;
    m3 += x * x * x / n;
    m4 += x * x * x * x / n;
    within_one += std::abs(x) < 1;
  }
  const double error = 5 / std::sqrt(n);
  EXPECT_NEAR(m1, 0, error);
  EXPECT_NEAR(m2, 1, std::sqrt(2.0) * error);
  EXPECT_NEAR(m3, 0, std::sqrt(15.0) * error);
  EXPECT_NEAR(m4, 3, std::sqrt(96.0) * error);
  EXPECT_NEAR(within_one / double(n), std::erf(1 / std::sqrt(2.0)), 0.5 * error);
}

TEST(Rng, IndexReachesEachValueEquallyOften) {
  Rng rng(10);
  std::vector<int> counts(7);
  for (int i = 0; i < 70000; ++i) {
    const int k = rng.index(7);
    ASSERT_GE(k, 0);
    ASSERT_LT(k, 7);
    ++counts[k];
  }
  for (int count : counts) EXPECT_NEAR(count, 10000, 5 * std::sqrt(10000 * 6 / 7.0));
  EXPECT_THROW(rng.index(0), std::invalid_argument);
}

}  // namespace
}  // namespace plumbline
