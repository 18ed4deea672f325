// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "plumbline/core/random.hpp"
#include "plumbline/synth/scene.hpp"

namespace plumbline {
namespace {

// A parameter's size when the image's corner is at radius 1: the lens is drawn for that and scaled to its
// field of view.
struct Term {
  std::string_view name;
  double value;
  int radius_power;  // the term grows with this power of the radius, relative to the undistorted radius
};

// Barrel distortion of about 12 % at the corner; every polynomial increases to well beyond it.
constexpr Term kPerspective[] = {
    {"k1", -0.22, 2}, {"k2", 0.08, 4},  {"k3", -0.015, 6}, {"k4", 0.1, 2},
    {"k5", -0.02, 4}, {"k6", 0.005, 6}, {"p1", 6e-4, 1},   {"p2", -8e-4, 1},
    {"s1", 8e-4, 1},  {"s2", -3e-4, 3}, {"s3", -6e-4, 1},  {"s4", 4e-4, 3},
};
constexpr Term kFisheye[] = {{"k1", 0.04, 2},   {"k2", -0.03, 4}, {"k3", 0.012, 6},
                             {"k4", -0.003, 8}, {"p1", 6e-4, 1},  {"p2", -8e-4, 1}};

void distort(Lens& lens, double corner_radius, Rng& rng) {
  const auto names = param_names(lens);
  const auto values = params(lens);
  const auto terms =
      is_central_perspective(lens) ? std::span<const Term>(kPerspective) : std::span<const Term>(kFisheye);
  for (std::size_t i = 4; i < names.size(); ++i) {
    // What is not a term of a polynomial is the seed's shape of a sphere (xi, alpha, ...), a little off.
    if (values[i] != 0) values[i] *= rng.uniform(0.95, 1.05);
    for (const Term& term : terms) {
      if (term.name != names[i]) continue;
      values[i] = term.value * rng.uniform(0.8, 1.2) / std::pow(corner_radius, term.radius_power);
    }
  }
}

}  // namespace

Result<Lens> simulated_lens(std::string_view name, double fov_deg, ImageSize size, bool distorted,
                            std::uint64_t seed) {
  auto made = make_lens(name, size, 1.0);
  if (!made) return made.error();
  Lens lens = *std::move(made);
  const double half = 0.5 * fov_deg * std::numbers::pi / 180;
  const bool forward = is_central_perspective(lens);
  if (!(half > 0) || fov_deg > (forward ? 170.0 : 300.0)) {
    return Error{ErrorCode::kInvalidData,
                 fmt::format("a field of view of {:g} degrees: a {} lens has more than 0 and at most {}",
                             fov_deg, name, forward ? 170 : 300),
                 "fov"};
  }
  Rng rng(seed ^ 0x6c656e7300000000ULL);
  const double corner_per_side = std::hypot(size.width, size.height) / size.width;
  if (distorted) {
    // The undistorted corner of a barrel lens is about a fifth farther out.
    const double corner_angle = std::min(half * corner_per_side, std::numbers::pi);
    const auto corner_px = project(lens, Vec3(std::sin(corner_angle), 0, std::cos(corner_angle)));
    const double corner = forward     ? 1.2 * std::tan(half) * corner_per_side
                          : corner_px ? (corner_px->x() - params(lens)[2]) / params(lens)[0]
                                      : corner_angle;
    distort(lens, corner, rng);
  }
  const auto values = params(lens);
  values[2] = values[3] = 0;
  const auto edge = project(lens, Vec3(std::sin(half), 0, std::cos(half)));
  if (!edge || !(edge->x() > 0)) {
    return Error{ErrorCode::kInvalidData, fmt::format("a {} lens cannot see {:g} degrees", name, fov_deg),
                 "fov"};
  }
  const double focal_px = values[0] * 0.5 * size.width / edge->x();
  values[0] = focal_px;
  values[1] = distorted ? 1.002 * focal_px : focal_px;
  values[2] = 0.5 * (size.width - 1) + (distorted ? rng.uniform(-0.01, 0.01) * size.width : 0);
  values[3] = 0.5 * (size.height - 1) + (distorted ? rng.uniform(-0.01, 0.01) * size.width : 0);
  return lens;
}

}  // namespace plumbline
