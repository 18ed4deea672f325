// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "plumbline/core/linalg.hpp"
#include "refine/seed.hpp"

namespace plumbline::detail {

namespace {

// A corner at angle theta from the axis: tan(theta), and the fisheye's distance from the centre divided by
// its focal length.
struct Radial {
  double tan = 0, r = 0;
};

// A radial term of a perspective lens, k * tan^(2 power), above or below the fraction.
struct Term {
  int index = 0;  // into the lens' parameters
  int power = 0;
  bool below = false;
};

std::vector<Term> radial_terms(const Lens& lens, const std::vector<bool>& held) {
  static constexpr std::array<std::string_view, 6> kNames{"k1", "k2", "k3", "k4", "k5", "k6"};
  std::vector<Term> terms;
  const auto names = param_names(lens);
  for (int i = 0; i < static_cast<int>(names.size()); ++i) {
    const auto at = std::find(kNames.begin(), kNames.end(), names[i]);
    if (at == kNames.end() || (!held.empty() && held[i])) continue;
    const int n = static_cast<int>(at - kNames.begin());
    terms.push_back({i, n % 3 + 1, n >= 3});
  }
  return terms;
}

double denominator(const std::vector<Term>& terms, const VecX& k, double s) {
  double d = 1;
  for (std::size_t j = 0; j < terms.size(); ++j) {
    if (terms[j].below) d += k[static_cast<int>(j)] * std::pow(s, terms[j].power);
  }
  return d;
}

// tan * N(s) / D(s) = r with s = tan^2 is linear in the coefficients once multiplied by D. Dividing by the D
// of the round before gives the weights that make the error that of r (Sanathanan and Koerner, "Transfer
// function synthesis as a ratio of two complex polynomials", 1963).
std::optional<VecX> fit_terms(const std::vector<Term>& terms, std::span<const Radial> profile) {
  constexpr int kRounds = 8;
  const int n = static_cast<int>(terms.size()), rows = static_cast<int>(profile.size());
  if (n == 0) return VecX(0);
  if (rows < n) return std::nullopt;
  VecX k = VecX::Zero(n);
  for (int round = 0; round < kRounds; ++round) {
    MatX A(rows, n);
    VecX b(rows);
    for (int i = 0; i < rows; ++i) {
      const auto [tan, r] = profile[i];
      const double s = tan * tan, w = 1 / denominator(terms, k, s);
      for (int j = 0; j < n; ++j) A(i, j) = w * (terms[j].below ? -r : tan) * std::pow(s, terms[j].power);
      b[i] = w * (r - tan);
    }
    const VecX scale = A.colwise().norm().transpose();
    if (!(scale.minCoeff() > 0) || !std::isfinite(scale.sum())) return std::nullopt;
    const auto x = solve_least_squares(A * scale.cwiseInverse().asDiagonal(), b);
    if (!x) return std::nullopt;
    k = x->cwiseQuotient(scale);
    if (terms.back().below == false) break;  // a polynomial is done at once
    for (const Radial& p : profile) {
      if (!(denominator(terms, k, p.tan * p.tan) > 0)) return std::nullopt;
    }
  }
  return k;
}

// Mean over the corners of the squared error of r, none more than `cap`; a corner outside the lens' domain
// counts with the cap.
double profile_error(const Lens& lens, std::span<const Radial> profile, double cap) {
  const auto k = params(lens);
  double sum = 0;
  for (const Radial& p : profile) {
    const auto px = project(lens, Vec3(p.tan, 0, 1));
    const double e = px ? std::min((px->x() - k[2]) / k[0] - p.r, cap) : cap;
    sum += std::min(e * e, cap * cap);
  }
  return sum;
}

// At most this many rays, spread evenly over the sorted angles: the widest is always among them.
std::vector<Radial> profile_of(const Lens& fisheye, std::vector<double> theta) {
  constexpr std::size_t kMost = 500;
  std::sort(theta.begin(), theta.end());
  std::vector<Radial> profile;
  const auto k = params(fisheye);
  const std::size_t step = theta.size() / kMost + 1;
  for (std::size_t back = 0; back < theta.size(); back += step) {
    const double angle = theta[theta.size() - 1 - back];
    const auto px = project(fisheye, Vec3(std::sin(angle), 0, std::cos(angle)));
    if (px && angle < 0.5 * std::numbers::pi) profile.push_back({std::tan(angle), (px->x() - k[2]) / k[0]});
  }
  std::reverse(profile.begin(), profile.end());
  return profile;
}

}  // namespace

std::optional<Lens> perspective_like(const Lens& fisheye, const std::string& lens_name, ImageSize size,
                                     const std::vector<double>& theta, const std::vector<bool>& held) {
  const auto k_fisheye = params(fisheye);
  const auto plain = make_lens(lens_name, size, k_fisheye[0]);
  if (!plain) return std::nullopt;
  Lens start = *plain;
  std::copy_n(k_fisheye.begin() + 1, 3, params(start).begin() + 1);
  const std::vector<Radial> profile = profile_of(fisheye, theta);
  const std::vector<Term> all = radial_terms(start, held);
  const double cap = 0.05 * std::hypot(size.width, size.height) / k_fisheye[0];
  Lens best = start;
  double best_error = profile_error(start, profile, cap);
  // A lens that can follow the fisheye to the widest corner wins at once over those fitted to less of the
  // view. The others must give up the rim: a fit that includes it would fold.
  for (double widest_deg : {90.0, 80.0, 70.0, 60.0, 50.0, 40.0}) {
    const double widest = widest_deg < 90 ? std::tan(widest_deg * std::numbers::pi / 180)
                                          : std::numeric_limits<double>::infinity();
    const auto end =
        std::partition_point(profile.begin(), profile.end(), [&](const Radial& p) { return p.tan < widest; });
    const std::span<const Radial> part(profile.begin(), end);
    for (std::vector<Term> terms = all; !terms.empty(); terms.pop_back()) {
      const auto k = fit_terms(terms, part);
      if (!k) continue;
      Lens lens = start;
      for (std::size_t j = 0; j < terms.size(); ++j) params(lens)[terms[j].index] = (*k)[static_cast<int>(j)];
      const double error = profile_error(lens, profile, cap);
      if (error < best_error) {
        best = lens;
        best_error = error;
      }
    }
  }
  return best;
}

}  // namespace plumbline::detail
