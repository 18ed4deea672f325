// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "plumbline/linear/camera_matrix.hpp"
#include "plumbline/linear/homography.hpp"
#include "plumbline/linear/zhang.hpp"
#include "refine/seed.hpp"

namespace plumbline::detail {

namespace {

std::optional<Lens> lens_with(const std::string& name, ImageSize size, double fx, double fy, double cx,
                              double cy) {
  auto lens = make_lens(name, size, fx);
  if (!lens) return std::nullopt;
  const auto k = params(*lens);
  k[1] = fy;
  k[2] = cx;
  k[3] = cy;
  return *lens;
}

// K of a closed form becomes a candidate when it is a camera that could exist.
void add_closed_form(std::vector<Lens>& list, const Mat3& K, const std::string& name, ImageSize size,
                     bool centre_held) {
  const double fx = K(0, 0), fy = K(1, 1), w = size.width, h = size.height;
  if (!(fx > 0.02 * w) || !(fx < 100 * w) || !(fy > 0.5 * fx) || !(fy < 2 * fx)) return;
  const bool centre_ok = !centre_held && K(0, 2) > 0 && K(0, 2) < w && K(1, 2) > 0 && K(1, 2) < h;
  const double cx = centre_ok ? K(0, 2) : 0.5 * (w - 1), cy = centre_ok ? K(1, 2) : 0.5 * (h - 1);
  if (auto lens = lens_with(name, size, fx, fy, cx, cy)) list.push_back(*lens);
}

void add_zhang(std::vector<Lens>& list, const Dataset& subset, const std::string& name, bool centre_held) {
  const ImageSize size = subset.cameras[0].size;
  std::vector<Mat3> H_px_board;
  for (const View& view : subset.views) {
    std::vector<Vec2> board, px;
    for (const Corner& c : view.corners) {
      board.push_back(subset.targets[0].points[c.point].head<2>());
      px.push_back(c.px);
    }
    if (board.size() < 4) continue;
    if (const auto H = homography(board, px)) H_px_board.push_back(*H);
  }
  if (H_px_board.size() >= 2) {
    if (const auto K = zhang_k(H_px_board, size)) add_closed_form(list, *K, name, size, centre_held);
  }
  if (!H_px_board.empty()) {
    if (const auto f = zhang_focal(H_px_board, size)) {
      const Mat3 K{{*f, 0, -1}, {0, *f, -1}, {0, 0, 1}};
      add_closed_form(list, K, name, size, centre_held);
    }
  }
}

void add_dlt(std::vector<Lens>& list, const Dataset& subset, const std::string& name, bool centre_held) {
  for (const View& view : subset.views) {
    std::vector<Vec3> p_world;
    std::vector<Vec2> px;
    for (const Corner& c : view.corners) {
      p_world.push_back(subset.targets[0].points[c.point]);
      px.push_back(c.px);
    }
    if (p_world.size() < 6) continue;
    const auto P = camera_matrix(p_world, px);
    if (!P) continue;
    if (const auto parts = decompose_camera_matrix(*P)) {
      add_closed_form(list, parts->K, name, subset.cameras[0].size, centre_held);
    }
  }
}

// A geometric grid of focal lengths without distortion: from a lens that sees 180 degrees in a tenth of the
// image's width to one that sees 7 degrees. Fisheyes and pinholes alike; the lens' own projection decides
// which fits.
void add_scan(std::vector<Lens>& list, const std::string& name, ImageSize size) {
  const double width = std::max(size.width, size.height);
  for (double ratio = 0.15; ratio < 8.5; ratio *= 1.2) {
    if (auto lens = make_lens(name, size, ratio * width)) list.push_back(*lens);
  }
}

bool points_lie_at_z0(const Target& target) {
  return std::all_of(target.points.begin(), target.points.end(), [](const Vec3& p) { return p.z() == 0.0; });
}

}  // namespace

std::vector<Lens> starting_lenses(const Dataset& subset, const std::string& lens_name, Start start,
                                  bool centre_held) {
  std::vector<Lens> list;
  const bool dlt = start == Start::kDlt || (start == Start::kAuto && !subset.targets[0].is_planar);
  if (dlt) add_dlt(list, subset, lens_name, centre_held);
  if (points_lie_at_z0(subset.targets[0]) && !dlt) add_zhang(list, subset, lens_name, centre_held);
  add_scan(list, lens_name, subset.cameras[0].size);
  return list;
}

}  // namespace plumbline::detail
