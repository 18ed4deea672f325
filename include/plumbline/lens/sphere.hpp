// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cmath>
#include <limits>

#include "plumbline/lens/concept.hpp"
#include "plumbline/lens/distorted.hpp"

/// Lenses that project onto a sphere or an ellipsoid first: they see beyond 90 degrees with few parameters.
namespace plumbline {

/// The unified camera model (Geyer & Daniilidis 2000; Mei & Rives 2007) without distortion, Kalibr's
/// omni-none: onto the unit sphere, then from a point xi above its centre. m = (X, Y) / (Z + xi |p|).
///
/// Domain: where the image of a growing angle from the axis grows, cos(theta) > -1/xi, and the denominator is
/// positive, cos(theta) > -xi.
struct UnifiedCamera {
  double fx = 1, fy = 1, cx = 0, cy = 0;  ///< [px]
  double xi = 0;

  static constexpr std::string_view kName = "ucm";
  static constexpr std::string_view kSummary =
      "unified camera model without distortion (Mei; Kalibr omni-none)";
  static constexpr int kNumParams = 5;
  static constexpr std::array<std::string_view, 5> kParamNames{"fx", "fy", "cx", "cy", "xi"};
  static constexpr bool kIsCentralPerspective = false;

  /// xi = 1 is the stereographic fisheye, from which both narrow and wide lenses are near.
  static UnifiedCamera seed(ImageSize size, double focal_px) {
    return {2 * focal_px, 2 * focal_px, 0.5 * (size.width - 1), 0.5 * (size.height - 1), 1};
  }

  template <class V>
  void distort(const V& X, const V& Y, const V& Z, V* m, V* J_m_p, V* J_m_d) const {
    using std::sqrt;
    const V n = sqrt(X * X + Y * Y + Z * Z), g = 1.0 / (Z + xi * n);
    m[0] = X * g, m[1] = Y * g;
    if (J_m_p) {
      const V s = xi / n * g, gx = m[0] * s, gy = m[1] * s, gz = g + Z * s;  // -d(1/g) g / d(X, Y, Z)
      J_m_p[0] = g - m[0] * (X * s), J_m_p[1] = -(gx * Y), J_m_p[2] = -(m[0] * gz);
      J_m_p[3] = -(gy * X), J_m_p[4] = g - m[1] * (Y * s), J_m_p[5] = -(m[1] * gz);
    }
    if (J_m_d) J_m_d[0] = -(m[0] * n * g), J_m_d[1] = -(m[1] * n * g);
  }

  std::optional<Vec2> project(const Vec3& p_cam, Mat23* J_px_p = nullptr,
                              JacParams<UnifiedCamera>* J_px_k = nullptr) const {
    const double n = p_cam.norm();
    if (!(n > 0 && n < std::numeric_limits<double>::infinity()) || !(xi > -1)) return std::nullopt;
    const double least = xi > 1 ? -1 / xi : -xi;
    if (!(p_cam.z() > least * n)) return std::nullopt;
    return detail::project_distorted(*this, p_cam, J_px_p, J_px_k);
  }

  template <class T>
  static void project_t(const T* k, const T* p_cam, T* px) {
    using std::sqrt;
    const T n = sqrt(p_cam[0] * p_cam[0] + p_cam[1] * p_cam[1] + p_cam[2] * p_cam[2]);
    const T z = p_cam[2] / n + k[4];
    px[0] = k[0] * (p_cam[0] / n / z) + k[2];
    px[1] = k[1] * (p_cam[1] / n / z) + k[3];
  }
};

/// The enhanced unified camera model (Khomutenko, Garcia & Martinet 2016), Kalibr's eucm: an ellipsoid
/// instead of the sphere. d = sqrt(beta (X^2 + Y^2) + Z^2), m = (X, Y) / (alpha d + (1 - alpha) Z).
///
/// Domain: 0 <= alpha <= 1, beta > 0, Z > -w d with w = alpha / (1 - alpha) for alpha <= 1/2 and (1 - alpha)
/// / alpha beyond: the same two conditions as UnifiedCamera's, carried over to the ellipsoid.
struct EnhancedUnifiedCamera {
  double fx = 1, fy = 1, cx = 0, cy = 0;  ///< [px]
  double alpha = 0, beta = 1;

  static constexpr std::string_view kName = "eucm";
  static constexpr std::string_view kSummary = "enhanced unified camera model (Kalibr eucm)";
  static constexpr int kNumParams = 6;
  static constexpr std::array<std::string_view, 6> kParamNames{"fx", "fy", "cx", "cy", "alpha", "beta"};
  static constexpr bool kIsCentralPerspective = false;

  static EnhancedUnifiedCamera seed(ImageSize size, double focal_px) {
    return {focal_px, focal_px, 0.5 * (size.width - 1), 0.5 * (size.height - 1), 0.5, 1};
  }

  template <class V>
  void distort(const V& X, const V& Y, const V& Z, V* m, V* J_m_p, V* J_m_d) const {
    using std::sqrt;
    const V rr = X * X + Y * Y, d = sqrt(beta * rr + Z * Z), g = 1.0 / (alpha * d + (1 - alpha) * Z);
    m[0] = X * g, m[1] = Y * g;
    const V id = 1.0 / d;
    if (J_m_p) {
      const V s = (alpha * beta) * id * g, z = (alpha * (Z * id) + (1 - alpha)) * g;
      J_m_p[0] = g - m[0] * (X * s), J_m_p[1] = -(m[0] * (Y * s)), J_m_p[2] = -(m[0] * z);
      J_m_p[3] = -(m[1] * (X * s)), J_m_p[4] = g - m[1] * (Y * s), J_m_p[5] = -(m[1] * z);
    }
    if (J_m_d) {
      const V a = (d - Z) * g, b = (0.5 * alpha) * rr * id * g;
      J_m_d[0] = -(m[0] * a), J_m_d[1] = -(m[1] * a), J_m_d[2] = -(m[0] * b), J_m_d[3] = -(m[1] * b);
    }
  }

  std::optional<Vec2> project(const Vec3& p_cam, Mat23* J_px_p = nullptr,
                              JacParams<EnhancedUnifiedCamera>* J_px_k = nullptr) const {
    const double d = std::sqrt(beta * p_cam.head<2>().squaredNorm() + p_cam.z() * p_cam.z());
    if (!(d > 0 && d < std::numeric_limits<double>::infinity())) return std::nullopt;
    if (!(alpha >= 0) || !(alpha <= 1) || !(beta > 0)) return std::nullopt;
    const double w = alpha > 0.5 ? (1 - alpha) / alpha : alpha / (1 - alpha);
    if (!(p_cam.z() > -w * d)) return std::nullopt;
    return detail::project_distorted(*this, p_cam, J_px_p, J_px_k);
  }

  template <class T>
  static void project_t(const T* k, const T* p_cam, T* px) {
    using std::sqrt;
    const T d = sqrt(k[5] * (p_cam[0] * p_cam[0] + p_cam[1] * p_cam[1]) + p_cam[2] * p_cam[2]);
    const T z = k[4] * d + (T(1) - k[4]) * p_cam[2];
    px[0] = k[0] * p_cam[0] / z + k[2];
    px[1] = k[1] * p_cam[1] / z + k[3];
  }
};

/// The double sphere model (Usenko, Demmel & Cremers 2018), Kalibr's ds: onto one unit sphere, then onto
/// another whose centre lies xi above, then from a point alpha / (1 - alpha) above that. d1 = |p|, q = xi d1
/// + Z, d2 = sqrt(X^2 + Y^2 + q^2), m = (X, Y) / (alpha d2 + (1 - alpha) q).
///
/// Domain (there, eq. 43 to 45): 0 <= alpha <= 1 and Z > -w2 d1, w2 = (w1 + xi) / sqrt(2 w1 xi + xi^2 + 1),
/// w1 = alpha / (1 - alpha) for alpha <= 1/2, (1 - alpha) / alpha beyond; |xi| < 1, so that the first step
/// keeps the order of the angles.
struct DoubleSphere {
  double fx = 1, fy = 1, cx = 0, cy = 0;  ///< [px]
  double xi = 0, alpha = 0;

  static constexpr std::string_view kName = "ds";
  static constexpr std::string_view kSummary = "double sphere (Usenko; Kalibr and Basalt ds)";
  static constexpr int kNumParams = 6;
  static constexpr std::array<std::string_view, 6> kParamNames{"fx", "fy", "cx", "cy", "xi", "alpha"};
  static constexpr bool kIsCentralPerspective = false;

  static DoubleSphere seed(ImageSize size, double focal_px) {
    return {focal_px, focal_px, 0.5 * (size.width - 1), 0.5 * (size.height - 1), 0, 0.5};
  }

  template <class V>
  void distort(const V& X, const V& Y, const V& Z, V* m, V* J_m_p, V* J_m_d) const {
    using std::sqrt;
    const V rr = X * X + Y * Y, d1 = sqrt(rr + Z * Z), q = xi * d1 + Z, d2 = sqrt(rr + q * q);
    const V g = 1.0 / (alpha * d2 + (1 - alpha) * q), i1 = 1.0 / d1, i2 = 1.0 / d2;
    m[0] = X * g, m[1] = Y * g;
    // The denominator's derivatives: by q, by X/X, by Z.
    const V by_q = alpha * (q * i2) + (1 - alpha);
    if (J_m_p) {
      const V s = (alpha * i2 + by_q * (xi * i1)) * g, z = by_q * (xi * (Z * i1) + 1.0) * g;
      J_m_p[0] = g - m[0] * (X * s), J_m_p[1] = -(m[0] * (Y * s)), J_m_p[2] = -(m[0] * z);
      J_m_p[3] = -(m[1] * (X * s)), J_m_p[4] = g - m[1] * (Y * s), J_m_p[5] = -(m[1] * z);
    }
    if (J_m_d) {
      const V by_xi = by_q * d1 * g, by_alpha = (d2 - q) * g;
      J_m_d[0] = -(m[0] * by_xi), J_m_d[1] = -(m[1] * by_xi);
      J_m_d[2] = -(m[0] * by_alpha), J_m_d[3] = -(m[1] * by_alpha);
    }
  }

  std::optional<Vec2> project(const Vec3& p_cam, Mat23* J_px_p = nullptr,
                              JacParams<DoubleSphere>* J_px_k = nullptr) const {
    const double d1 = p_cam.norm();
    if (!(d1 > 0 && d1 < std::numeric_limits<double>::infinity())) return std::nullopt;
    if (!(alpha >= 0) || !(alpha <= 1) || !(std::abs(xi) < 1)) return std::nullopt;
    const double w1 = alpha > 0.5 ? (1 - alpha) / alpha : alpha / (1 - alpha);
    const double w2 = (w1 + xi) / std::sqrt(2 * w1 * xi + xi * xi + 1);
    if (!(p_cam.z() > -w2 * d1)) return std::nullopt;
    return detail::project_distorted(*this, p_cam, J_px_p, J_px_k);
  }

  template <class T>
  static void project_t(const T* k, const T* p_cam, T* px) {
    using std::sqrt;
    const T rr = p_cam[0] * p_cam[0] + p_cam[1] * p_cam[1];
    const T q = k[4] * sqrt(rr + p_cam[2] * p_cam[2]) + p_cam[2];
    const T z = k[5] * sqrt(rr + q * q) + (T(1) - k[5]) * q;
    px[0] = k[0] * p_cam[0] / z + k[2];
    px[1] = k[1] * p_cam[1] / z + k[3];
  }
};

}  // namespace plumbline
