// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/two_view_degeneracy.hpp"

#include <fmt/format.h>

#include "linear/degeneracy.hpp"
#include "linear/pixel_pairs.hpp"
#include "plumbline/core/check.hpp"

namespace plumbline {

const char* to_string(TwoViewDegeneracy kind) {
  switch (kind) {
    case TwoViewDegeneracy::kNone:
      return "none";
    case TwoViewDegeneracy::kPlanarScene:
      return "the scene is a plane";
    case TwoViewDegeneracy::kPureRotation:
      return "the camera only turned";
  }
  return "";
}

std::string TwoViewComparison::text() const {
  if (kind == TwoViewDegeneracy::kNone) return {};
  const char* next = kind == TwoViewDegeneracy::kPureRotation
                         ? "move the camera between the views, or use the homography, which is a rotation"
                         : "use the homography, or points at different depths";
  return fmt::format(
      "{}: a homography explains {} of {} pairs (at least {} off it are needed), whose parallax has {:.3g} "
      "times the variance of the noise (at least {:.3g} are needed; noise {:.2g} px); {}",
      to_string(kind), n - n_off, n, n_off_needed, ratio, ratio_needed, noise_px, next);
}

TwoViewComparison compare_with_homography(const Mat3& F, std::span<const Vec2> px1,
                                          std::span<const Vec2> px2) {
  PLUMBLINE_CHECK(px1.size() == px2.size() && px1.size() >= 8,
                  "compare_with_homography needs as many pixels in px1 as in px2, 8 or more");
  const detail::PixelPairs pairs(px1, px2);
  TwoViewComparison out = detail::compare(pairs.normalised(F), pairs.a, pairs.b, pairs.rounding_px(),
                                          [&](const Mat3& H, std::span<const int> on) {
                                            return detail::is_turn(H, pairs.a, pairs.b, on,
                                                                   pairs.T_common_1(), pairs.T_common_2());
                                          });
  out.H = pairs.denormalised_homography(out.H);
  return out;
}

}  // namespace plumbline
