// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cmath>
#include <limits>

#include "plumbline/lens/brown_conrady.hpp"
#include "plumbline/lens/concept.hpp"
#include "plumbline/lens/distorted.hpp"

/// Lenses that project onto a sphere or an ellipsoid first: they see beyond 90 degrees with few parameters.
namespace plumbline {

namespace detail {

/// 1 / (alpha d + (1 - alpha) z) with d = sqrt(a + z^2). Behind the camera, where the sum would cancel, by
/// d + z = a / (d - z).
template <class V>
V inverse_height(double alpha, const V& a, const V& d, const V& z) {
  const V both = d - z;
  const auto behind = z < 0.0 * z;
  return select(behind, both, 1.0 + 0.0 * z) /
         select(behind, alpha * a + (1 - 2 * alpha) * z * both, alpha * d + (1 - alpha) * z);
}

/// xi n + z with n = sqrt(a + z^2); behind the camera, where z + n would cancel, by z + n = a / (n - z).
template <class V>
V lifted_height(double xi, const V& a, const V& n, const V& z) {
  const V both = n - z;
  return select(z < 0.0 * z, (a + (xi - 1) * n * both) / both, z + xi * n);
}

/// d = sqrt(beta (X^2 + Y^2) + Z^2), m = (X, Y) / (alpha d + (1 - alpha) Z), as LensModel's distort() with
/// the derivatives by alpha and beta apart.
template <class V>
void distort_by_ellipsoid(double alpha, double beta, const V& X, const V& Y, const V& Z, V* m, V* J_m_p,
                          V* J_m_alpha, V* J_m_beta) {
  using std::sqrt;
  const V rr = X * X + Y * Y, b_rr = beta * rr, d = sqrt(b_rr + Z * Z);
  const V g = inverse_height(alpha, b_rr, d, Z);
  m[0] = X * g, m[1] = Y * g;
  const V id = 1.0 / d;
  if (J_m_p) {
    const V s = (alpha * beta) * id * g, z = (alpha * (Z * id) + (1 - alpha)) * g;
    J_m_p[0] = g - m[0] * (X * s), J_m_p[1] = -(m[0] * (Y * s)), J_m_p[2] = -(m[0] * z);
    J_m_p[3] = -(m[1] * (X * s)), J_m_p[4] = g - m[1] * (Y * s), J_m_p[5] = -(m[1] * z);
  }
  if (J_m_alpha) {
    const V a = (d - Z) * g;
    J_m_alpha[0] = -(m[0] * a), J_m_alpha[1] = -(m[1] * a);
  }
  if (J_m_beta) {
    const V b = (0.5 * alpha) * rr * id * g;
    J_m_beta[0] = -(m[0] * b), J_m_beta[1] = -(m[1] * b);
  }
}

/// Whether alpha d + (1 - alpha) Z > 0, the denominator, and alpha Z + (1 - alpha) d > 0, the slope of the
/// radial map but for a positive factor; both hold on the axis, and each ends once on the way outward, so
/// that the domain is a cone. For 0 <= alpha <= 1 the two are the Z > -w d of the papers, w the smaller of
/// alpha / (1 - alpha) and its inverse.
inline bool in_ellipsoid_domain(double alpha, double d, double z) {
  return alpha * d + (1 - alpha) * z > 0 && alpha * z + (1 - alpha) * d > 0;
}

/// The same for the ellipsoid of beta and a point. With beta < 0, a hyperboloid, d vanishes at the edge and
/// the image is stretched there without bound: the domain ends where d = Z / 10, so that derivatives keep
/// their digits.
inline bool sees_by_ellipsoid(double alpha, double beta, const Vec3& p_cam) {
  const double zz = p_cam.z() * p_cam.z(), dd = beta * p_cam.head<2>().squaredNorm() + zz;
  if (!(dd > 0 && dd < std::numeric_limits<double>::infinity())) return false;
  if (beta < 0 && !(p_cam.z() > 0 && dd > 0.01 * zz)) return false;
  return in_ellipsoid_domain(alpha, std::sqrt(dd), p_cam.z());
}

}  // namespace detail

/// The unified camera model without distortion (Geyer & Daniilidis 2000; Mei & Rives 2007): onto the unit
/// sphere, then from a point above its centre. In the form of Usenko, Demmel & Cremers 2018, eq. 8, whose
/// focal length is that of the image's centre: m = (X, Y) / (alpha |p| + (1 - alpha) Z). Mei's parameters,
/// those of Kalibr's omni-none, are xi = alpha / (1 - alpha) and gamma = f / (1 - alpha).
///
/// Domain: alpha |p| + (1 - alpha) Z > 0 and alpha Z + (1 - alpha) |p| > 0.
struct UnifiedCamera {
  double fx = 1, fy = 1, cx = 0, cy = 0;  ///< [px]
  double alpha = 0;

  static constexpr std::string_view kName = "ucm";
  static constexpr std::string_view kSummary =
      "unified camera model without distortion (Kalibr omni-none, Basalt ucm)";
  static constexpr int kNumParams = 5;
  static constexpr std::array<std::string_view, 5> kParamNames{"fx", "fy", "cx", "cy", "alpha"};
  static constexpr bool kIsCentralPerspective = false;

  /// alpha = 1/2 is the stereographic fisheye, from which both narrow and wide lenses are near.
  static UnifiedCamera seed(ImageSize size, double focal_px) {
    return {focal_px, focal_px, 0.5 * (size.width - 1), 0.5 * (size.height - 1), 0.5};
  }

  template <class V>
  void distort(const V& X, const V& Y, const V& Z, V* m, V* J_m_p, V* J_m_d) const {
    detail::distort_by_ellipsoid(alpha, 1.0, X, Y, Z, m, J_m_p, J_m_d, static_cast<V*>(nullptr));
  }

  std::optional<Vec2> project(const Vec3& p_cam, Mat23* J_px_p = nullptr,
                              JacParams<UnifiedCamera>* J_px_k = nullptr) const {
    if (!detail::sees_by_ellipsoid(alpha, 1, p_cam)) return std::nullopt;
    return detail::project_distorted(*this, p_cam, J_px_p, J_px_k);
  }

  template <class T>
  static void project_t(const T* k, const T* p_cam, T* px) {
    using std::sqrt;
    // Onto the sphere of radius 1 - alpha, then from a point alpha above its centre.
    const T n = sqrt(p_cam[0] * p_cam[0] + p_cam[1] * p_cam[1] + p_cam[2] * p_cam[2]);
    const T a = T(1) - k[4], x = p_cam[0] / n, y = p_cam[1] / n, z = a * p_cam[2] / n + k[4];
    px[0] = k[0] * x / z + k[2];
    px[1] = k[1] * y / z + k[3];
  }
};

/// The unified camera model with Brown's distortion (Mei & Rives 2007), Kalibr's omni-radtan, camodocal's
/// MEI, OpenCV's omnidir: (x, y) = (X, Y) / (Z + xi |p|), distorted as opencv4 does, px = (fx x'' + cx,
/// fy y'' + cy). fx and fy are Mei's gammas: the focal length of the centre is fx / (1 + xi).
///
/// Domain: xi > -1, Z + xi |p| > 0, |p| + xi Z > 0 (the image of a growing angle grows), and (x, y) inside
/// opencv4's disc.
struct Mei {
  double fx = 1, fy = 1, cx = 0, cy = 0;  ///< [px]
  double xi = 0;
  std::array<double, 4> d{};  ///< k1 k2 p1 p2

  static constexpr std::string_view kName = "mei";
  static constexpr std::string_view kSummary =
      "unified camera model with Brown's distortion (Mei; Kalibr omni-radtan, camodocal MEI)";
  static constexpr int kNumParams = 9;
  static constexpr std::array<std::string_view, 9> kParamNames{"fx", "fy", "cx", "cy", "xi",
                                                               "k1", "k2", "p1", "p2"};
  static constexpr bool kIsCentralPerspective = false;

  /// xi = 1 is the stereographic fisheye.
  static Mei seed(ImageSize size, double focal_px) {
    return {2 * focal_px, 2 * focal_px, 0.5 * (size.width - 1), 0.5 * (size.height - 1), 1, {}};
  }

  template <class V>
  void distort(const V& X, const V& Y, const V& Z, V* m, V* J_m_p, V* J_m_d) const {
    using std::sqrt;
    const V rr = X * X + Y * Y, n = sqrt(rr + Z * Z), W = detail::lifted_height(xi, rr, n, Z);
    OpenCV4 brown;  // of the point (X, Y, W)
    brown.d = d;
    V J[6];
    brown.distort(X, Y, W, m, J_m_p || J_m_d ? J : nullptr, J_m_d ? J_m_d + 2 : nullptr);
    if (J_m_p) {
      const V in = xi / n, W_x = X * in, W_y = Y * in, W_z = 1.0 + Z * in;
      J_m_p[0] = J[0] + J[2] * W_x, J_m_p[1] = J[1] + J[2] * W_y, J_m_p[2] = J[2] * W_z;
      J_m_p[3] = J[3] + J[5] * W_x, J_m_p[4] = J[4] + J[5] * W_y, J_m_p[5] = J[5] * W_z;
    }
    if (J_m_d) J_m_d[0] = J[2] * n, J_m_d[1] = J[5] * n;
  }

  std::optional<Vec2> project(const Vec3& p_cam, Mat23* J_px_p = nullptr,
                              JacParams<Mei>* J_px_k = nullptr) const {
    const double n = p_cam.norm(), W = p_cam.z() + xi * n;
    constexpr double inf = std::numeric_limits<double>::infinity();
    if (!(n > 0 && n < inf) || !(xi > -1 && xi < inf)) return std::nullopt;
    if (!(W > 0) || !(n + xi * p_cam.z() > 0)) return std::nullopt;
    OpenCV4 brown;
    brown.d = d;
    const double x = p_cam.x() / W, y = p_cam.y() / W;
    if (!brown.in_domain(x * x + y * y)) return std::nullopt;
    return detail::project_distorted(*this, p_cam, J_px_p, J_px_k);
  }

  template <class T>
  static void project_t(const T* k, const T* p_cam, T* px) {
    using std::sqrt;
    const T n = sqrt(p_cam[0] * p_cam[0] + p_cam[1] * p_cam[1] + p_cam[2] * p_cam[2]);
    const T z = p_cam[2] / n + k[4], x = p_cam[0] / n / z, y = p_cam[1] / n / z;
    const T rho2 = x * x + y * y, radial = k[5] * rho2 + k[6] * rho2 * rho2;
    px[0] = k[0] * (x + x * radial + T(2) * k[7] * x * y + k[8] * (rho2 + T(2) * x * x)) + k[2];
    px[1] = k[1] * (y + y * radial + k[7] * (rho2 + T(2) * y * y) + T(2) * k[8] * x * y) + k[3];
  }
};

/// The enhanced unified camera model (Khomutenko, Garcia & Martinet 2016), Kalibr's eucm: an ellipsoid
/// instead of the sphere. d = sqrt(beta (X^2 + Y^2) + Z^2), m = (X, Y) / (alpha d + (1 - alpha) Z).
///
/// Domain: alpha d + (1 - alpha) Z > 0 and alpha Z + (1 - alpha) d > 0. The papers keep to 0 <= alpha <= 1
/// and beta > 0; the formula does not need that, and a solver can pass. For beta < 0 also Z > 0 and
/// d > Z / 10.
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
    detail::distort_by_ellipsoid(alpha, beta, X, Y, Z, m, J_m_p, J_m_d, J_m_d ? J_m_d + 2 : nullptr);
  }

  std::optional<Vec2> project(const Vec3& p_cam, Mat23* J_px_p = nullptr,
                              JacParams<EnhancedUnifiedCamera>* J_px_k = nullptr) const {
    if (!detail::sees_by_ellipsoid(alpha, beta, p_cam)) return std::nullopt;
    return detail::project_distorted(*this, p_cam, J_px_p, J_px_k);
  }

  template <class T>
  static void project_t(const T* k, const T* p_cam, T* px) {
    using std::sqrt;
    const T rho2 = k[5] * (p_cam[0] * p_cam[0] + p_cam[1] * p_cam[1]) + p_cam[2] * p_cam[2];
    const T z = p_cam[2] + k[4] * (sqrt(rho2) - p_cam[2]);
    px[0] = k[0] * p_cam[0] / z + k[2];
    px[1] = k[1] * p_cam[1] / z + k[3];
  }
};

/// The double sphere model (Usenko, Demmel & Cremers 2018), Kalibr's ds: onto one unit sphere, then onto
/// another whose centre lies xi above, then from a point alpha / (1 - alpha) above that. d1 = |p|, q = xi d1
/// + Z, d2 = sqrt(X^2 + Y^2 + q^2), m = (X, Y) / (alpha d2 + (1 - alpha) q).
///
/// Domain: xi > -1, d1 + xi Z > 0 (the angle on the second sphere grows), alpha d2 + (1 - alpha) q > 0 and
/// alpha q + (1 - alpha) d2 > 0. With |xi| < 1 and 0 <= alpha <= 1 that is eq. 43 to 45 of the paper.
struct DoubleSphere {
  double fx = 1, fy = 1, cx = 0, cy = 0;  ///< [px]
  double xi = 0, alpha = 0;

  static constexpr std::string_view kName = "ds";
  static constexpr std::string_view kSummary = "double sphere (Kalibr and Basalt ds)";
  static constexpr int kNumParams = 6;
  static constexpr std::array<std::string_view, 6> kParamNames{"fx", "fy", "cx", "cy", "xi", "alpha"};
  static constexpr bool kIsCentralPerspective = false;

  static DoubleSphere seed(ImageSize size, double focal_px) {
    return {focal_px, focal_px, 0.5 * (size.width - 1), 0.5 * (size.height - 1), 0, 0.5};
  }

  template <class V>
  void distort(const V& X, const V& Y, const V& Z, V* m, V* J_m_p, V* J_m_d) const {
    using std::sqrt;
    const V rr = X * X + Y * Y, d1 = sqrt(rr + Z * Z), q = detail::lifted_height(xi, rr, d1, Z),
            d2 = sqrt(rr + q * q);
    const V g = detail::inverse_height(alpha, rr, d2, q), i1 = 1.0 / d1, i2 = 1.0 / d2;
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
    const double d1 = p_cam.norm(), q = xi * d1 + p_cam.z();
    constexpr double inf = std::numeric_limits<double>::infinity();
    if (!(d1 > 0 && d1 < inf) || !(xi > -1 && xi < inf)) return std::nullopt;
    const double d2 = std::sqrt(p_cam.head<2>().squaredNorm() + q * q);
    if (!(d1 + xi * p_cam.z() > 0) || !detail::in_ellipsoid_domain(alpha, d2, q)) return std::nullopt;
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
