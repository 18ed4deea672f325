// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>

namespace plumbline {

/// Seeded random numbers that are the same on every platform and standard library (std::normal_distribution
/// is not). splitmix64 (Steele, Lea, Flood 2014); normals by Box and Muller (1958).
class Rng {
 public:
  explicit Rng(std::uint64_t seed) : state_(seed) {}
  std::uint64_t bits();
  double uniform(double low = 0.0, double high = 1.0);  ///< in [low, high), low < high
  double normal(double sigma = 1.0);                    ///< mean 0
  int index(int n);                                     ///< in [0, n); throws for n < 1

 private:
  std::uint64_t state_;
  double spare_ = 0.0;
  bool has_spare_ = false;
};

}  // namespace plumbline
