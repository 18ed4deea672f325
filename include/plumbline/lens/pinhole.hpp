// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cmath>

#include "plumbline/lens/concept.hpp"

namespace plumbline {

/// The pinhole camera: px = (fx x/z + cx, fy y/z + cy). Hartley & Zisserman 2004, eq. 6.4 without skew.
/// Domain: z > 0.
struct Pinhole {
  double fx = 1, fy = 1, cx = 0, cy = 0;  ///< [px]

  static constexpr std::string_view kName = "pinhole";
  static constexpr std::string_view kSummary = "no distortion";
  static constexpr int kNumParams = 4;
  static constexpr std::array<std::string_view, 4> kParamNames{"fx", "fy", "cx", "cy"};
  static constexpr bool kIsCentralPerspective = true;

  static Pinhole seed(ImageSize size, double focal_px) {
    return {focal_px, focal_px, 0.5 * (size.width - 1), 0.5 * (size.height - 1)};
  }

  std::optional<Vec2> project(const Vec3& p_cam, Mat23* J_px_p = nullptr,
                              JacParams<Pinhole>* J_px_k = nullptr) const {
    const double iz = 1 / p_cam.z(), x = p_cam.x() * iz, y = p_cam.y() * iz;
    const Vec2 px(fx * x + cx, fy * y + cy);
    if (!(iz > 0) || !std::isfinite(px.x() + px.y())) return std::nullopt;  // iz: 0 for z = inf, NaN for NaN
    if (J_px_p) *J_px_p << fx * iz, 0, -fx * x * iz, 0, fy * iz, -fy * y * iz;
    if (J_px_k) *J_px_k << x, 0, 1, 0, 0, y, 0, 1;
    return px;
  }

  template <class T>
  static void project_t(const T* k, const T* p_cam, T* px) {
    px[0] = k[0] * p_cam[0] / p_cam[2] + k[2];
    px[1] = k[1] * p_cam[1] / p_cam[2] + k[3];
  }
};

}  // namespace plumbline
