// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plumbline/refine/start.hpp"
#include "refine/seed.hpp"
#include "refine/solve.hpp"

namespace plumbline {
namespace {

using namespace detail;

// The image of a lens as a data set: a "board" of the unit rays of a grid of pixels, one view, in the
// camera's frame.
Dataset image_of(const Lens& lens, ImageSize size, bool forward_only) {
  constexpr int kColumns = 40, kRows = 30;
  constexpr double kLeastZ = 0.02;  // a perspective lens cannot follow a fisheye to 90 degrees
  Dataset data;
  data.cameras = {{"camera", size}};
  data.frames = {"grid"};
  data.targets.resize(1);
  Target& rays = data.targets[0];
  rays.is_planar = false;
  View view;
  view.image = "grid";
  for (int r = 0; r < kRows; ++r) {
    for (int c = 0; c < kColumns; ++c) {
      const Vec2 px(c * (size.width - 1.0) / (kColumns - 1), r * (size.height - 1.0) / (kRows - 1));
      const auto ray = unproject(lens, px);
      if (!ray || (forward_only && ray->z() < kLeastZ)) continue;
      view.corners.push_back({static_cast<int>(rays.points.size()), px, 1.0});
      rays.points.push_back(*ray);
    }
  }
  data.views = {view};
  return data;
}

// All of the lens' parameters that the first solve leaves alone: an error of the start would go into the high
// orders.
std::vector<bool> held_first(const Lens& lens) {
  std::vector<bool> held;
  for (const std::string_view name : param_names(lens))
    held.push_back(!(name == "fx" || name == "fy" || name == "k1" || name == "k2"));
  return held;
}

}  // namespace

Result<Lens> convert_lens(const Lens& from, const std::string& name, ImageSize size) {
  if (lens_name(from) == name) return from;
  const auto plain = make_lens(name, size, params(from)[0]);
  if (!plain) return plain.error();
  Lens lens = *plain;
  std::copy_n(params(from).begin(), 4, params(lens).begin());
  const bool forward_only = is_central_perspective(lens);
  const Dataset image = image_of(from, size, forward_only);
  if (forward_only && !is_central_perspective(from)) {
    std::vector<double> theta;
    for (const Vec3& ray : image.targets[0].points)
      theta.push_back(std::atan2(ray.head<2>().norm(), ray.z()));
    if (const auto like = perspective_like(from, name, size, theta, {})) lens = *like;
  }
  Calibration cal = empty_calibration(image, {lens});
  cal.T_rig_board[0] = SE3();
  cal.fits[0].resize(image.views[0].corners.size());
  SolveSpec spec{.hold_boards = true};
  bool solved = false;
  for (const bool all : {false, true, true}) {
    bring_back(cal);  // rays that came into the domain
    spec.held = all ? std::vector<bool>{} : held_first(lens);
    Calibration trial = cal;
    if (!solve(trial, spec).usable) continue;
    cal = std::move(trial);
    solved = true;
  }
  if (!solved)
    return Error{ErrorCode::kNotConverged,
                 fmt::format("no lens {} projects like this {}", name, lens_name(from)), "lens"};
  return cal.rig.cameras[0].lens;
}

}  // namespace plumbline
