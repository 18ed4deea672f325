// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "plumbline/lens/concept.hpp"
#include "plumbline/lens/distorted.hpp"
#include "plumbline/lens/sphere.hpp"

/// Radial lenses with one parameter.
namespace plumbline {

/// The FOV model (Devernay & Faugeras 2001), Kalibr's pinhole-fov: r_d = atan(2 tan(w/2) r / Z) / w, here
/// with atan2, so that it goes on beyond 90 degrees. -w means the same as w, and w = 0 is the pinhole camera.
/// Domain: |w| < pi, any angle below pi.
struct FieldOfView {
  double fx = 1, fy = 1, cx = 0, cy = 0;  ///< [px]
  double w = 1;                           ///< [rad]

  static constexpr std::string_view kName = "fov";
  static constexpr std::string_view kSummary = "FOV model of Devernay and Faugeras (Kalibr pinhole-fov)";
  static constexpr int kNumParams = 5;
  static constexpr std::array<std::string_view, 5> kParamNames{"fx", "fy", "cx", "cy", "w"};
  static constexpr bool kIsCentralPerspective = false;

  /// w = 1: near the middle of what lenses have, and r_d = r (1.09 + ...) near the axis.
  static FieldOfView seed(ImageSize size, double focal_px) {
    const double f = focal_px / (2 * std::tan(0.5));
    return {f, f, 0.5 * (size.width - 1), 0.5 * (size.height - 1), 1};
  }

  template <class V>
  void distort(const V& X, const V& Y, const V& Z, V* m, V* J_m_p, V* J_m_d) const {
    using detail::select;
    using std::atan2;
    using std::sqrt;
    const double u = std::abs(w) < 1e-9 ? 1e-9 : w;  // there it has long become the pinhole camera
    const double t = 2 * std::tan(0.5 * u), t_w = 1 + 0.25 * t * t, iw = 1 / u;  // t_w = dt/dw
    const V rr = X * X + Y * Y, r = sqrt(rr), angle = atan2(std::abs(t) * r, Z), hh = (t * t) * rr + Z * Z;
    const auto on_axis = r < 1e-9 * Z;
    const V inv_r = 1.0 / r, g = select(on_axis, (t * iw) / Z, std::abs(iw) * angle * inv_r);  // r_d / r
    m[0] = X * g, m[1] = Y * g;
    if (J_m_p) {
      // d(angle)/dr = t Z / hh, d(angle)/dZ = -t r / hh
      const V g_r = select(on_axis, 0.0 * Z, ((t * iw) * (Z / hh) - g) * inv_r * inv_r),
              g_z = -((t * iw) / hh);
      J_m_p[0] = g + X * X * g_r, J_m_p[1] = X * Y * g_r, J_m_p[2] = X * g_z;
      J_m_p[3] = J_m_p[1], J_m_p[4] = g + Y * Y * g_r, J_m_p[5] = Y * g_z;
    }
    if (J_m_d) {
      const V g_w = iw * ((t_w) * (Z / hh) - g);
      J_m_d[0] = X * g_w, J_m_d[1] = Y * g_w;
    }
  }

  std::optional<Vec2> project(const Vec3& p_cam, Mat23* J_px_p = nullptr,
                              JacParams<FieldOfView>* J_px_k = nullptr) const {
    const double nn = p_cam.squaredNorm();
    if (!(nn > 0 && nn < std::numeric_limits<double>::infinity())) return std::nullopt;
    if (!(std::abs(w) < std::numbers::pi)) return std::nullopt;
    if (!(std::hypot(p_cam.x(), p_cam.y()) > 0) && p_cam.z() < 0) return std::nullopt;
    return detail::project_distorted(*this, p_cam, J_px_p, J_px_k);
  }

  template <class T>
  static void project_t(const T* k, const T* p_cam, T* px) {
    using std::atan2;
    using std::sqrt;
    using std::tan;
    const T r = sqrt(p_cam[0] * p_cam[0] + p_cam[1] * p_cam[1]);
    const T r_d = atan2(T(2) * tan(k[4] / T(2)) * r, p_cam[2]) / k[4];
    px[0] = k[0] * r_d * p_cam[0] / r + k[2];
    px[1] = k[1] * r_d * p_cam[1] / r + k[3];
  }
};

/// The division model (Fitzgibbon 2001): the ray of a distorted point is (x_d, y_d, 1 + lambda r_d^2). Solved
/// for the distorted point: m = 2 (X, Y) / (Z + sqrt(Z^2 - 4 lambda (X^2 + Y^2))), which is eucm's map with
/// alpha = 1/2 and beta = -4 lambda.
///
/// Domain: lambda < 0 (barrel): every direction but straight back; lambda = 0: Z > 0; lambda > 0: Z > 0 and
/// the square root more than Z / 10, where the image is stretched tenfold.
struct Division {
  double fx = 1, fy = 1, cx = 0, cy = 0;  ///< [px]
  double lambda = 0;

  static constexpr std::string_view kName = "division";
  static constexpr std::string_view kSummary = "one-parameter division model (Fitzgibbon; COLMAP DIVISION)";
  static constexpr int kNumParams = 5;
  static constexpr std::array<std::string_view, 5> kParamNames{"fx", "fy", "cx", "cy", "lambda"};
  static constexpr bool kIsCentralPerspective = false;

  static Division seed(ImageSize size, double focal_px) {
    return {focal_px, focal_px, 0.5 * (size.width - 1), 0.5 * (size.height - 1), -0.1};
  }

  template <class V>
  void distort(const V& X, const V& Y, const V& Z, V* m, V* J_m_p, V* J_m_d) const {
    detail::distort_by_ellipsoid(0.5, -4 * lambda, X, Y, Z, m, J_m_p, static_cast<V*>(nullptr), J_m_d);
    if (J_m_d) J_m_d[0] = -4.0 * J_m_d[0], J_m_d[1] = -4.0 * J_m_d[1];
  }

  std::optional<Vec2> project(const Vec3& p_cam, Mat23* J_px_p = nullptr,
                              JacParams<Division>* J_px_k = nullptr) const {
    if (!detail::sees_by_ellipsoid(0.5, -4 * lambda, p_cam)) return std::nullopt;
    return detail::project_distorted(*this, p_cam, J_px_p, J_px_k);
  }

  template <class T>
  static void project_t(const T* k, const T* p_cam, T* px) {
    using std::sqrt;
    const T rr = p_cam[0] * p_cam[0] + p_cam[1] * p_cam[1];
    const T g = T(2) / (p_cam[2] + sqrt(p_cam[2] * p_cam[2] - T(4) * k[4] * rr));
    px[0] = k[0] * g * p_cam[0] + k[2];
    px[1] = k[1] * g * p_cam[1] + k[3];
  }
};

}  // namespace plumbline
