// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cmath>
#include <optional>

#include "plumbline/lens/concept.hpp"

namespace plumbline::detail {

/// a where the condition holds, else b; packs of doubles have an overload of their own.
inline double select(bool condition, double a, double b) { return condition ? a : b; }

/// px = (fx m_x + cx, fy m_y + cy) with m = lens.distort(p_cam), for a point inside the domain, with its
/// derivatives on request; nullopt when the pixel is not finite.
template <class L>
std::optional<Vec2> project_distorted(const L& lens, const Vec3& p_cam, Mat23* J_px_p, JacParams<L>* J_px_k) {
  constexpr int kDistortion = L::kNumParams - 4;
  double m[2], J_m_p[6], J_m_d[2 * kDistortion + 1];
  lens.distort(p_cam.x(), p_cam.y(), p_cam.z(), m, J_px_p ? J_m_p : nullptr, J_px_k ? J_m_d : nullptr);
  const Vec2 px(lens.fx * m[0] + lens.cx, lens.fy * m[1] + lens.cy);
  if (!std::isfinite(px.x() + px.y())) return std::nullopt;
  if (J_px_p) {
    *J_px_p << lens.fx * J_m_p[0], lens.fx * J_m_p[1], lens.fx * J_m_p[2],  //
        lens.fy * J_m_p[3], lens.fy * J_m_p[4], lens.fy * J_m_p[5];
  }
  if (J_px_k) {
    J_px_k->template leftCols<4>() << m[0], 0, 1, 0, 0, m[1], 0, 1;
    for (int i = 0; i < kDistortion; ++i) {
      (*J_px_k)(0, 4 + i) = lens.fx * J_m_d[2 * i];
      (*J_px_k)(1, 4 + i) = lens.fy * J_m_d[2 * i + 1];
    }
  }
  return px;
}

}  // namespace plumbline::detail
