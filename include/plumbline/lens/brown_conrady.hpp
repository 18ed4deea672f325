// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cmath>

#include "plumbline/lens/concept.hpp"
#include "plumbline/lens/distorted.hpp"
#include "plumbline/lens/polynomial.hpp"

namespace plumbline {

/// Brown's radial and decentring distortion as OpenCV numbers it: N = 4 (k1 k2 p1 p2), 5 (+ k3), 8 (+ k4 k5
/// k6, the rational model), 12 (+ s1 s2 s3 s4, thin prism). Brown, "Close-range camera calibration" (1971);
/// the rational form: Claus & Fitzgibbon 2005. With x = X/Z, y = Y/Z, s = x^2 + y^2:
///
///   c   = (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3)
///   x'' = x c + 2 p1 x y + p2 (s + 2 x^2) + s1 s + s2 s^2
///   y'' = y c + p1 (s + 2 y^2) + 2 p2 x y + s3 s + s4 s^2
///   px  = (fx x'' + cx, fy y'' + cy)
///
/// Domain: z > 0 inside the widest disc r < r_max in which the image cannot fold over itself. From the axis
/// out to r the denominator stays positive and the slope of the radial map, d(r c)/dr, stays above
///
///   e(r) = r (6 |(p1, p2)| + 2 max over [0, s] of |(s1 + 2 s2 s, s3 + 2 s4 s)|),
///
/// the most that tangential and prism terms take away from it in any direction. The symmetric part of
/// d(x'', y'')/d(x, y) is then positive definite in the disc, and a map with that property on a convex set is
/// one to one (Gale & Nikaido 1965, theorem 6). Without those terms e = 0 and r_max is where the radial map
/// turns back.
template <int N>
struct BrownConrady {
  static_assert(N == 4 || N == 5 || N == 8 || N == 12);
  double fx = 1, fy = 1, cx = 0, cy = 0;  ///< [px]
  std::array<double, N> d{};              ///< k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4]]], no unit

  static constexpr std::string_view kName = N == 4   ? "opencv4"
                                            : N == 5 ? "opencv5"
                                            : N == 8 ? "opencv8"
                                                     : "opencv12";
  static constexpr std::string_view kSummary = N == 4 ? "Brown-Conrady, two radial and two tangential terms"
                                               : N == 5
                                                   ? "Brown-Conrady, three radial and two tangential terms"
                                               : N == 8 ? "rational radial and two tangential terms"
                                                        : "rational radial, tangential and thin prism terms";
  static constexpr int kNumParams = 4 + N;
  static constexpr bool kIsCentralPerspective = true;
  static constexpr std::array<std::string_view, kNumParams> kParamNames = [] {
    constexpr std::array<std::string_view, 16> all{"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2",
                                                   "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"};
    std::array<std::string_view, kNumParams> names{};
    for (int i = 0; i < kNumParams; ++i) names[i] = all[i];
    return names;
  }();

  static BrownConrady seed(ImageSize size, double focal_px) {
    return {focal_px, focal_px, 0.5 * (size.width - 1), 0.5 * (size.height - 1), {}};
  }

  /// Distorted coordinates m = (x'', y'') of a point inside the domain; V is double, or a pack of doubles for
  /// as many points. On request d(m)/d(p_cam), row by row, and d(m)/d(d): N pairs.
  template <class V>
  void distort(const V& X, const V& Y, const V& Z, V* m, V* J_m_p, V* J_m_d) const {
    const double k1 = d[0], k2 = d[1], p1 = d[2], p2 = d[3], k3 = at(4);
    const V iz = 1.0 / Z, x = X * iz, y = Y * iz, xx = x * x, yy = y * y, xy = x * y, s = xx + yy;
    const V n = 1.0 + s * (k1 + s * (k2 + s * k3)), a = s + 2.0 * xx, b = s + 2.0 * yy;
    V iq = 1.0 + 0.0 * s, c = n;
    if constexpr (N >= 8) {
      iq = 1.0 / (1.0 + s * (at(5) + s * (at(6) + s * at(7))));
      c = n * iq;
    }
    m[0] = x * c + (2 * p1) * xy + p2 * a;
    m[1] = y * c + p1 * b + (2 * p2) * xy;
    if constexpr (N >= 12) {
      m[0] = m[0] + s * (at(8) + s * at(9));
      m[1] = m[1] + s * (at(10) + s * at(11));
    }
    if (J_m_p) {
      // d(xd, yd)/d(x, y), with c_s = dc/ds; the prism terms add 2 x (s1 + 2 s2 s) and so on.
      V c_s = k1 + s * (2 * k2 + (3 * k3) * s);
      if constexpr (N >= 8) c_s = (c_s - c * (at(5) + s * (2 * at(6) + (3 * at(7)) * s))) * iq;
      const V mixed = 2.0 * (xy * c_s + p1 * x + p2 * y);
      V xd_x = c + 2.0 * xx * c_s + (2 * p1) * y + (6 * p2) * x, xd_y = mixed;
      V yd_y = c + 2.0 * yy * c_s + (6 * p1) * y + (2 * p2) * x, yd_x = mixed;
      if constexpr (N >= 12) {
        const V ux = at(8) + (2 * at(9)) * s, uy = at(10) + (2 * at(11)) * s;
        xd_x = xd_x + 2.0 * x * ux, xd_y = xd_y + 2.0 * y * ux;
        yd_y = yd_y + 2.0 * y * uy, yd_x = yd_x + 2.0 * x * uy;
      }
      J_m_p[0] = xd_x * iz, J_m_p[1] = xd_y * iz, J_m_p[2] = -(x * J_m_p[0] + y * J_m_p[1]);
      J_m_p[3] = yd_x * iz, J_m_p[4] = yd_y * iz, J_m_p[5] = -(x * J_m_p[3] + y * J_m_p[4]);
    }
    if (J_m_d) {
      const V si = s * iq, u1 = x * si, u2 = u1 * s, v1 = y * si, v2 = v1 * s;
      J_m_d[0] = u1, J_m_d[1] = v1, J_m_d[2] = u2, J_m_d[3] = v2;
      J_m_d[4] = 2.0 * xy, J_m_d[5] = b, J_m_d[6] = a, J_m_d[7] = 2.0 * xy;
      if constexpr (N >= 5) J_m_d[8] = u2 * s, J_m_d[9] = v2 * s;
      if constexpr (N >= 8) {
        for (int i = 0; i < 2; ++i) {
          J_m_d[10 + i] = -(c * J_m_d[i]), J_m_d[12 + i] = -(c * J_m_d[2 + i]),
                     J_m_d[14 + i] = -(c * J_m_d[8 + i]);
        }
      }
      if constexpr (N >= 12) {
        const V zero = 0.0 * s, ss = s * s;
        J_m_d[16] = s, J_m_d[17] = zero, J_m_d[18] = ss, J_m_d[19] = zero;
        J_m_d[20] = zero, J_m_d[21] = s, J_m_d[22] = zero, J_m_d[23] = ss;
      }
    }
  }

  std::optional<Vec2> project(const Vec3& p_cam, Mat23* J_px_p = nullptr,
                              JacParams<BrownConrady>* J_px_k = nullptr) const {
    const double iz = 1 / p_cam.z(), x = p_cam.x() * iz, y = p_cam.y() * iz;
    if (!(iz > 0) || !in_domain(x * x + y * y)) return std::nullopt;  // iz: 0 for z = inf, NaN for NaN
    return detail::project_distorted(*this, p_cam, J_px_p, J_px_k);
  }

  template <class T>
  static void project_t(const T* k, const T* p_cam, T* px) {
    const T x = p_cam[0] / p_cam[2], y = p_cam[1] / p_cam[2], r2 = x * x + y * y;
    const T r4 = r2 * r2, r6 = r4 * r2;
    T radial = T(1) + k[4] * r2 + k[5] * r4;
    if constexpr (N >= 5) radial += k[8] * r6;
    if constexpr (N >= 8) radial /= T(1) + k[9] * r2 + k[10] * r4 + k[11] * r6;
    T xd = x * radial + T(2) * k[6] * x * y + k[7] * (r2 + T(2) * x * x);
    T yd = y * radial + k[6] * (r2 + T(2) * y * y) + T(2) * k[7] * x * y;
    if constexpr (N >= 12) {
      xd += k[12] * r2 + k[13] * r4;
      yd += k[14] * r2 + k[15] * r4;
    }
    px[0] = k[0] * xd + k[2];
    px[1] = k[1] * yd + k[3];
  }

  /// Whether the disc of squared radius s = x^2 + y^2 lies in the domain; false for NaN and infinity.
  bool in_domain(double s) const {
    const double k1 = d[0], k2 = d[1], k3 = at(4);
    double e = 6 * std::sqrt(s * (d[2] * d[2] + d[3] * d[3]));
    if constexpr (N >= 12) {  // |(s1 + 2 s2 s, s3 + 2 s4 s)| is convex in s: its largest value is at an end
      const double ux = at(8) + 2 * at(9) * s, uy = at(10) + 2 * at(11) * s;
      e += 2 * std::sqrt(s * std::fmax(at(8) * at(8) + at(10) * at(10), ux * ux + uy * uy));
    }
    if constexpr (N < 8) {
      return detail::positive_on(std::array<double, 4>{1 - e, 3 * k1, 5 * k2, 7 * k3}, s);
    } else {
      // With c = n / q the slope is m / q^2, m = (n + 2 s n') q - 2 s n q': the coefficient of s^(i+j) in m
      // is n_i q_j (1 + 2 i - 2 j). Slope > e becomes m - e q^2 > 0.
      const double k4 = at(5), k5 = at(6), k6 = at(7);
      return detail::positive_on(std::array<double, 4>{1, k4, k5, k6}, s) &&
             detail::positive_on(
                 std::array<double, 7>{1 - e, 3 * k1 - k4 - e * (2 * k4),
                                       5 * k2 + k1 * k4 - 3 * k5 - e * (2 * k5 + k4 * k4),
                                       7 * k3 + 3 * k2 * k4 - k1 * k5 - 5 * k6 - e * 2 * (k6 + k4 * k5),
                                       5 * k3 * k4 + k2 * k5 - 3 * k1 * k6 - e * (2 * k4 * k6 + k5 * k5),
                                       3 * k3 * k5 - k2 * k6 - e * 2 * k5 * k6, k3 * k6 - e * k6 * k6},
                 s);
    }
  }

 private:
  double at(int i) const { return i < N ? d[static_cast<std::size_t>(i < N ? i : 0)] : 0.0; }
};

using OpenCV4 = BrownConrady<4>;
using OpenCV5 = BrownConrady<5>;
using OpenCV8 = BrownConrady<8>;
using OpenCV12 = BrownConrady<12>;

}  // namespace plumbline
