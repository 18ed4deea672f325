// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "plumbline/lens/concept.hpp"
#include "plumbline/lens/distorted.hpp"
#include "plumbline/lens/polynomial.hpp"

namespace plumbline {

/// Kannala and Brandt, "A generic camera model and calibration method for conventional, wide-angle, and
/// fish-eye lenses" (2006), with the four terms that OpenCV's fisheye module, Kalibr ("equidistant") and ROS
/// use:
///
///   theta = angle from the optical axis, atan2(r, Z), r = hypot(X, Y)
///   d(theta) = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)
///   px = (fx d X/r + cx, fy d Y/r + cy)
///
/// Domain: theta < pi and d increasing all the way from the axis to theta; points behind the camera project
/// too.
struct KannalaBrandt4 {
  double fx = 1, fy = 1, cx = 0, cy = 0;  ///< [px]
  double k1 = 0, k2 = 0, k3 = 0, k4 = 0;

  static constexpr std::string_view kName = "kb4";
  static constexpr std::string_view kSummary = "Kannala-Brandt fisheye (OpenCV fisheye, Kalibr equidistant)";
  static constexpr int kNumParams = 8;
  static constexpr std::array<std::string_view, 8> kParamNames{"fx", "fy", "cx", "cy",
                                                               "k1", "k2", "k3", "k4"};
  static constexpr bool kIsCentralPerspective = false;

  static KannalaBrandt4 seed(ImageSize size, double focal_px) {
    return {focal_px, focal_px, 0.5 * (size.width - 1), 0.5 * (size.height - 1), 0, 0, 0, 0};
  }

  /// m = d(theta) (X, Y) / r of a point inside the domain; V is double, or a pack of doubles for as many
  /// points. On request d(m)/d(p_cam), row by row, and d(m)/d(k1..k4): four pairs.
  template <class V>
  void distort(const V& X, const V& Y, const V& Z, V* m, V* J_m_p, V* J_m_d) const {
    using detail::select;
    using std::atan2;
    using std::sqrt;
    const V rr = X * X + Y * Y, r = sqrt(rr), nn = rr + Z * Z, theta = atan2(r, Z), s = theta * theta;
    const V c = 1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4)));  // d(theta) / theta
    // g = d(theta)/r: m = g X. On the axis theta/r -> 1/Z; straight back it grows without bound instead.
    const auto on_axis = r < 1e-9 * Z;
    const V inv_r = 1.0 / r, theta_r = select(on_axis, 1.0 / Z, theta * inv_r), g = c * theta_r;
    m[0] = g * X, m[1] = g * Y;
    if (J_m_p) {
      const V d_theta = 1.0 + s * (3 * k1 + s * (5 * k2 + s * (7 * k3 + s * (9 * k4))));
      // dg/dr / r = (d'(theta) Z / nn - g) / rr, and dg/dZ = -d'(theta) / nn
      const V g_z = -(d_theta / nn), g_r = select(on_axis, 0.0 * Z, -((g_z * Z + g) * inv_r * inv_r));
      J_m_p[0] = g + X * X * g_r, J_m_p[1] = X * Y * g_r, J_m_p[2] = X * g_z;
      J_m_p[3] = J_m_p[1], J_m_p[4] = g + Y * Y * g_r, J_m_p[5] = Y * g_z;
    }
    if (J_m_d) {
      J_m_d[0] = X * theta_r * s, J_m_d[1] = Y * theta_r * s;
      for (int i = 2; i < 8; ++i) J_m_d[i] = J_m_d[i - 2] * s;
    }
  }

  std::optional<Vec2> project(const Vec3& p_cam, Mat23* J_px_p = nullptr,
                              JacParams<KannalaBrandt4>* J_px_k = nullptr) const {
    const double nn = p_cam.squaredNorm();
    if (!(nn > 0 && nn < std::numeric_limits<double>::infinity())) return std::nullopt;
    const double theta = std::atan2(std::hypot(p_cam.x(), p_cam.y()), p_cam.z());
    if (!(theta < std::numbers::pi) ||
        !detail::positive_on(std::array<double, 5>{1, 3 * k1, 5 * k2, 7 * k3, 9 * k4}, theta * theta)) {
      return std::nullopt;
    }
    return detail::project_distorted(*this, p_cam, J_px_p, J_px_k);
  }

  template <class T>
  static void project_t(const T* k, const T* p_cam, T* px) {
    using std::atan2;
    using std::sqrt;
    const T r = sqrt(p_cam[0] * p_cam[0] + p_cam[1] * p_cam[1]), theta = atan2(r, p_cam[2]),
            t2 = theta * theta;
    const T d = theta * (T(1) + k[4] * t2 + k[5] * t2 * t2 + k[6] * t2 * t2 * t2 + k[7] * t2 * t2 * t2 * t2);
    px[0] = k[0] * d * p_cam[0] / r + k[2];
    px[1] = k[1] * d * p_cam[1] / r + k[3];
  }
};

}  // namespace plumbline
