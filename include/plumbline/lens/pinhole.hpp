// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cmath>

#include "plumbline/lens/concept.hpp"
#include "plumbline/lens/distorted.hpp"

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

  /// m = (x/z, y/z) of a point inside the domain; V is double, or a pack of doubles for as many points. On
  /// request d(m)/d(p_cam), row by row.
  template <class V>
  void distort(const V& X, const V& Y, const V& Z, V* m, V* J_m_p, V* /*J_m_d*/) const {
    const V iz = 1.0 / Z, zero = 0.0 * Z;
    m[0] = X * iz, m[1] = Y * iz;
    if (!J_m_p) return;
    J_m_p[0] = iz, J_m_p[1] = zero, J_m_p[2] = -(m[0] * iz);
    J_m_p[3] = zero, J_m_p[4] = iz, J_m_p[5] = -(m[1] * iz);
  }

  std::optional<Vec2> project(const Vec3& p_cam, Mat23* J_px_p = nullptr,
                              JacParams<Pinhole>* J_px_k = nullptr) const {
    if (!(1 / p_cam.z() > 0)) return std::nullopt;  // 0 for z = inf, NaN for NaN
    return detail::project_distorted(*this, p_cam, J_px_p, J_px_k);
  }

  template <class T>
  static void project_t(const T* k, const T* p_cam, T* px) {
    px[0] = k[0] * p_cam[0] / p_cam[2] + k[2];
    px[1] = k[1] * p_cam[1] / p_cam[2] + k[3];
  }
};

}  // namespace plumbline
