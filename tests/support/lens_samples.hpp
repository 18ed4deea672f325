// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <variant>
#include <vector>

#include <gtest/gtest.h>

#include "plumbline/core/random.hpp"
#include "plumbline/lens/lens.hpp"

/// Lenses and points for tests that know nothing about any one lens.
namespace plumbline::test {

/// ::testing::Types of those alternatives of Lens whose number of parameters is fixed, so that a new lens is
/// tested without an edit. A lens with a run-time number of parameters has tests of its own.
template <class... L>
::testing::Types<L...> types_of(std::tuple<L...>);
template <class L>
using IfFixed = std::conditional_t<FixedLens<L>, std::tuple<L>, std::tuple<>>;
template <class... L>
auto fixed_types(std::variant<L...>*) -> decltype(types_of(std::tuple_cat(std::declval<IfFixed<L>>()...)));
using LensTypes = decltype(fixed_types(static_cast<Lens*>(nullptr)));

/// Their names, in the order of the list.
inline std::vector<std::string_view> fixed_lens_names() {
  std::vector<std::string_view> names = lens_names();
  std::erase_if(names, [](std::string_view name) {
    return is_sparse(make_lens(name, {640, 480}, 500).value());
  });
  return names;
}

struct LensTypeName {
  template <class L>
  static std::string GetName(int) {
    return std::string(L::kName);
  }
};

/// What the image is larger by at the centre than the focal length says; infinite where the lens sees
/// nothing.
template <class L>
double magnification(const L& lens) {
  const auto px = lens.project(Vec3(1e-3, 0, 1));
  return px ? (px->x() - lens.cx) / (1e-3 * lens.fx) : std::numeric_limits<double>::infinity();
}

/// A lens around its seed: focal lengths and centre as cameras have them, every further parameter moved by a
/// normal number of the given size. 0: the seed; 0.02: mild; 0.2: strong; 2: far beyond any glass. What does
/// not see along its own axis (a viewpoint behind the sphere), or magnifies the centre by more than 20, is no
/// lens, and is drawn again.
template <class L>
L random_lens(Rng& rng, double distortion) {
  L lens = L::seed({1280, 960}, rng.uniform(200, 1500));
  lens.fy *= rng.uniform(0.9, 1.1);
  lens.cx += rng.uniform(-60, 60);
  lens.cy += rng.uniform(-60, 60);
  double* k = &lens.fx;
  const L seed = lens;
  do {
    for (int i = 4; i < L::kNumParams; ++i) k[i] = (&seed.fx)[i] + rng.normal(distortion);
  } while (!(magnification(lens) < 20));
  return lens;
}

/// A plausible lens of each name after its focal lengths and centre: some tens of pixels of distortion at 30
/// degrees off the axis, every parameter set; far from folding over 75 degrees.
inline Lens lens_like_glass(std::string_view name, const std::vector<double>& fx_fy_cx_cy) {
  static const std::map<std::string_view, std::vector<double>> rest{
      {"pinhole", {}},
      {"opencv4", {-0.25, 0.09, 0.0012, -0.0007}},
      {"opencv5", {-0.25, 0.09, 0.0012, -0.0007, -0.02}},
      {"opencv8", {-0.25, 0.09, 0.0012, -0.0007, 0.01, 0.10, 0.05, 0.03}},
      {"opencv12", {-0.25, 0.09, 0.0012, -0.0007, 0.01, 0.10, 0.05, 0.03, 0.0008, -0.0003, -0.0006, 0.0004}},
      {"kb4", {-0.02, 0.008, -0.003, 0.0005}},
      {"ucm", {0.57}},
      {"mei", {0.9, -0.08, 0.02, 0.0012, -0.0007}},
      {"eucm", {0.6, 1.1}},
      {"ds", {-0.2, 0.55}},
      {"fov", {0.93}},
      {"division", {-0.21}}};
  std::vector<double> k = fx_fy_cx_cy;
  // Mei's focal lengths are 1 + xi times those of the centre.
  if (name == "mei") k[0] *= 1.9, k[1] *= 1.9;
  const std::vector<double>& d = rest.at(name);
  k.insert(k.end(), d.begin(), d.end());
  return make_lens(name, k).value();
}

/// Pixel by the lens' plain definition (project_t), which the lens' own code does not use; nullopt outside
/// the domain.
inline std::optional<Vec2> project_plainly(const Lens& lens, const Vec3& p_cam) {
  if (!project(lens, p_cam)) return std::nullopt;
  return std::visit(
      [&]<class L>(const L& l) {
        Vec2 px = Vec2::Zero();
        if constexpr (FixedLens<L>) L::project_t(&l.fx, p_cam.data(), px.data());
        return px;
      },
      lens);
}

/// The sizes of distortion that every property is tested with.
inline const std::vector<double>& distortions() {
  static const std::vector<double> sizes{0, 0.02, 0.2, 2};
  return sizes;
}

/// The point `theta` radians from the optical axis in the direction `phi`, at a distance.
inline Vec3 point_at(double theta, double phi, double distance = 1) {
  return distance * Vec3(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta));
}

/// Where to look for points of a lens type: short of 90 degrees, or all around.
template <class L>
constexpr double widest_angle() {
  return L::kIsCentralPerspective ? 0.4999 * std::numbers::pi : std::numbers::pi;
}

/// The first angle along `phi` that the lens does not project to within `farthest_px` of its centre, to 1e-12
/// rad; widest_angle when there is none.
template <class L>
double edge_of_domain(const L& lens, double phi, double farthest_px = 1e300) {
  double low = 0, high = widest_angle<L>();
  for (int i = 0; i < 45; ++i) {
    const double middle = 0.5 * (low + high);
    const auto px = lens.project(point_at(middle, phi));
    (px && (*px - Vec2(lens.cx, lens.cy)).norm() < farthest_px ? low : high) = middle;
  }
  return low;
}

/// The farthest pixel from the centre that points_in_domain asks for [px], some twenty images away. Further
/// out, at the pole of a rational lens or at 90 degrees, a rounding of the input alone moves the pixel by
/// more than 1e-9.
constexpr double kFarthestPx = 2e4;

/// n points inside the domain, over all directions and angles up to the edge (the outermost close to it).
template <class L>
std::vector<Vec3> points_in_domain(const L& lens, Rng& rng, int n) {
  std::vector<Vec3> points;
  for (int i = 0; i < n; ++i) {
    const double phi = rng.uniform(0, 2 * std::numbers::pi), edge = edge_of_domain(lens, phi, kFarthestPx);
    const double share = i % 10 == 0 ? 1 - std::pow(10, rng.uniform(-8, -2)) : std::sqrt(rng.uniform());
    const Vec3 p = point_at(edge * share, phi, std::pow(10, rng.uniform(-2, 2)));
    if (lens.project(p)) points.push_back(p);
  }
  return points;
}

}  // namespace plumbline::test
