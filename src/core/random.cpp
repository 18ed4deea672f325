// SPDX-License-Identifier: Apache-2.0
#include "plumbline/core/random.hpp"

#include <cmath>
#include <numbers>

#include "plumbline/core/check.hpp"

namespace plumbline {

std::uint64_t Rng::bits() {
  std::uint64_t z = (state_ += 0x9E3779B97F4A7C15ULL);
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
  return z ^ (z >> 31);
}

double Rng::uniform(double low, double high) {
  const double value = low + (high - low) * (static_cast<double>(bits() >> 11) * 0x1.0p-53);
  return value < high ? value : std::nextafter(high, low);  // the sum may have been rounded up to high
}

double Rng::normal(double sigma) {
  if (has_spare_) {
    has_spare_ = false;
    return sigma * spare_;
  }
  const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
  const double angle = 2.0 * std::numbers::pi * uniform();
  spare_ = radius * std::sin(angle);
  has_spare_ = true;
  return sigma * radius * std::cos(angle);
}

int Rng::index(int n) {
  PLUMBLINE_CHECK(n > 0, "Rng::index needs a count above zero");
  return static_cast<int>(uniform() * n);
}

}  // namespace plumbline
