// SPDX-License-Identifier: Apache-2.0
// A pixel through a lens and back: the smallest program that uses Plumbline.
#include <cstdio>
#include <plumbline/lens/lens.hpp>

int main() {
  const double parameters[] = {520, 520, 319.5, 239.5, -0.28, 0.07, 0.001, -0.0005, 0.01};
  const auto lens = plumbline::make_lens("opencv5", parameters);
  if (!lens) {
    std::fprintf(stderr, "%s\n", lens.error().text().c_str());
    return 1;
  }
  const plumbline::Vec3 p_cam(0.2, -0.1, 1.0);  // [m]: x right, y down, z forward
  const auto px = plumbline::project(*lens, p_cam);
  const auto ray_cam = px ? plumbline::unproject(*lens, *px) : std::nullopt;
  if (!ray_cam) {
    std::fprintf(stderr, "the point is outside the lens' domain\n");
    return 1;
  }
  std::printf("pixel (%.3f, %.3f); its ray misses the point by %.1e rad\n", px->x(), px->y(),
              (*ray_cam - p_cam.normalized()).norm());
  return (*ray_cam - p_cam.normalized()).norm() < 1e-9 ? 0 : 1;
}
